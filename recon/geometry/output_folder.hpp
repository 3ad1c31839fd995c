#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "realtime/kernel/descriptor.hpp"

namespace fathom {

// A folder that appears whole or not at all: work in path() ("<folder>.tmp"), then commit() puts it in the
// place of the old one. Without commit() it is removed and the old one stays. Whole after the program was
// killed; after a power loss too if it is durable. One program at a time writes it, where the file system has
// locks. Of a symbolic link it is what the link leads to that is replaced.
class OutputFolder {
 public:
  // For work that goes on after the program was stopped.
  struct Life {
    bool outlives = false;  // without commit() what is in path() stays there
    bool reopen = false;    // what an earlier program left in path() is kept
    bool durable = false;   // commit() brings all of it to the disk before it has its name, then the name
  };
  // Gives two folders each other's names in one step; false where the file system cannot.
  using Exchange = std::function<bool(const std::filesystem::path&, const std::filesystem::path&)>;

  // `ours`: the files that earlier runs may have left there, at any depth, as shell patterns of their paths
  // in the folder (fnmatch's, with extended ones): "mesh.ply", "layers/@(slope|views).tif". Throws InputError
  // when the place is no folder, holds any other file (it would be lost), cannot be created, or is being
  // written; "<folder>.tmp" and "<folder>.old.tmp" may hold files with ".tmp" in their names beside. A folder
  // that a commit() cut short had put aside is back in its place before.
  OutputFolder(const std::filesystem::path& folder, std::span<const std::string_view> ours, const Life& life);
  OutputFolder(const std::filesystem::path& folder, std::span<const std::string_view> ours)
      : OutputFolder(folder, ours, Life()) {}
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return temporary_; }
  // Throws InputError, and leaves the old folder, when another file came into it meanwhile, and
  // std::runtime_error when the disk refuses. Where folders
  // cannot be exchanged the old one is "<folder>.old.tmp" until the new one stands in its place.
  void commit(const Exchange& exchange = exchanged);

 private:
  [[nodiscard]] static bool exchanged(const std::filesystem::path& a, const std::filesystem::path& b);
  void refuseOtherFiles(const std::filesystem::path& folder) const;
  void takeOver(bool reopen);
  void bringToDisk() const;

  std::filesystem::path folder_, temporary_, aside_;
  std::vector<std::string> ours_;
  bool outlives_, durable_;
  Descriptor lock_, old_lock_;  // of path(); after an exchange, of what is in path() then
};

}  // namespace fathom
