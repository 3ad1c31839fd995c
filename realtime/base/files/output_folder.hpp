#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "realtime/base/files/descriptor.hpp"

namespace fathom {

// Output folder of a program that appears whole or not at all. The program works in path() ("<folder>.tmp");
// commit() puts it in the place of the old folder. Without commit() it is removed and the old folder stays.
// That holds if the program is killed, and after a power loss if the folder is durable. Where the file system
// has locks only one program at a time can write it. If `folder` is a symbolic link, its target is replaced.
class OutputFolder {
 public:
  // Options for work that continues after the program was stopped.
  struct Life {
    bool outlives = false;  // without commit() what is in path() stays there
    bool reopen = false;    // what an earlier program left in path() is kept
    bool durable = false;   // commit() brings all of it to the disk before it has its name, then the name
  };
  // Exchanges the names of two folders in one step; false where the file system cannot.
  using Exchange = std::function<bool(const std::filesystem::path&, const std::filesystem::path&)>;

  // `ours`: shell patterns (fnmatch, extended) of the paths that earlier runs may have left in the folder:
  // "mesh.ply", "layers/@(slope|views).tif". Throws InputError when the place is not a folder, holds any
  // other file (which would be lost), cannot be created, or is being written; "<folder>.tmp" and
  // "<folder>.old.tmp" may also hold files with ".tmp" in their names. A folder that an interrupted commit()
  // had put aside is restored first.
  OutputFolder(const std::filesystem::path& folder, std::span<const std::string_view> ours, const Life& life);
  OutputFolder(const std::filesystem::path& folder, std::span<const std::string_view> ours)
      : OutputFolder(folder, ours, Life()) {}
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return temporary_; }
  // Throws InputError, and leaves the old folder, when another file was put into it meanwhile; throws
  // std::runtime_error when the disk refuses. Where folders cannot be exchanged, the old one is
  // "<folder>.old.tmp" until the new one is in its place.
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
