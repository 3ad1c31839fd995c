#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace fathom::io {

// A file (or pipe) of captured bytes, read in pieces from front to back. A folder, an absent or an empty file
// is an InputError, at construction or at the first read.
class ByteFile {
 public:
  explicit ByteFile(std::filesystem::path path);

  // Fills up to `buffer.size()` bytes and returns what was read; 0 at the end. Throws InputError on a read
  // error, or when the very first read finds the file empty.
  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer);

 private:
  struct Close {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };
  std::filesystem::path path_;
  std::unique_ptr<std::FILE, Close> file_;
  bool anything_read_ = false;
};

// The bytes of a regular file of 1 to `max_bytes` bytes. Throws InputError for an absent, unreadable, empty
// or larger file; `what`: its expected content ("a mission.toml").
[[nodiscard]] std::vector<std::uint8_t> readFileBytes(const std::filesystem::path& path,
                                                      std::size_t max_bytes, const char* what);

}  // namespace fathom::io

namespace fathom {

// The numbers of a text file, separated by white space, read in order; keeps the position for error messages.
class NumberFile {
 public:
  // Throws InputError for a file that cannot be read (`what`: its expected content) and for a word that is
  // not a number.
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
