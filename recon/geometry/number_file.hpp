#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fathom {

// The numbers of a text file, separated by white space, taken in order; remembers the place for error lines.
class NumberFile {
 public:
  // Throws InputError for a file that cannot be read (`what` it should be) and for a word that is no number.
  NumberFile(const std::filesystem::path& path, const std::string& what);
  [[nodiscard]] std::size_t count() const { return numbers_.size(); }
  double next() { return numbers_[index_++]; }
  [[noreturn]] void fail(const std::string& fix) const;

 private:
  std::filesystem::path path_;
  std::vector<double> numbers_;
  std::size_t index_ = 0;
};

}  // namespace fathom
