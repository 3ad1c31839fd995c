#pragma once

#include <filesystem>

namespace fathom::topside {

// A folder that appears whole or not at all: work in path() ("<folder>.tmp"), then commit() puts it in the
// place of the old one. Without commit() it is removed and the old one stays.
class OutputFolder {
 public:
  // Throws InputError when the place holds something that no run of this program made (it would be lost).
  explicit OutputFolder(std::filesystem::path folder);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return temporary_; }
  void commit();

 private:
  std::filesystem::path folder_, temporary_;
};

}  // namespace fathom::topside
