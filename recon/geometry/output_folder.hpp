#pragma once

#include <filesystem>
#include <span>
#include <string_view>

namespace fathom {

// A folder that appears whole or not at all: work in path() ("<folder>.tmp"), then commit() puts it in the
// place of the old one. Without commit() it is removed and the old one stays.
class OutputFolder {
 public:
  // `ours`: the names that earlier runs may have left there. Throws InputError when the place is no folder,
  // holds anything else (it would be lost), or cannot be made.
  OutputFolder(const std::filesystem::path& folder, std::span<const std::string_view> ours);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return temporary_; }
  void commit();

 private:
  std::filesystem::path folder_, temporary_;
};

}  // namespace fathom
