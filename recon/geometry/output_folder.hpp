#pragma once

#include <filesystem>
#include <span>
#include <string_view>

namespace fathom {

// A folder that appears whole or not at all: work in path() ("<folder>.tmp"), then commit() puts it in the
// place of the old one. Without commit() it is removed and the old one stays.
class OutputFolder {
 public:
  // For work that goes on after the program was stopped.
  struct Life {
    bool outlives = false;  // without commit() what is in path() stays there
    bool reopen = false;    // what an earlier program left in path() is kept
  };

  // `ours`: the names that earlier runs may have left there. Throws InputError when the place is no folder,
  // holds anything else (it would be lost), or cannot be made.
  OutputFolder(const std::filesystem::path& folder, std::span<const std::string_view> ours, const Life& life);
  OutputFolder(const std::filesystem::path& folder, std::span<const std::string_view> ours)
      : OutputFolder(folder, ours, Life()) {}
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return temporary_; }
  void commit();

 private:
  std::filesystem::path folder_, temporary_;
  bool outlives_;
};

}  // namespace fathom
