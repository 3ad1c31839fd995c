#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <ostream>
#include <span>
#include <string_view>

namespace fathom {

// A file that appears whole or not at all: written to "<path>.tmp", renamed by commit(). Without commit() the
// temporary file is removed. Throws std::runtime_error when the disk refuses.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  std::ofstream& stream() { return stream_; }
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_;
  std::ofstream stream_;
  bool committed_ = false;
};

// Writes all contents through an AtomicFile.
void writeFile(const std::filesystem::path& path, std::string_view contents);
void writeFile(const std::filesystem::path& path, std::span<const std::uint8_t> contents);

// Temporary file for contents that are appended to another file later; removed with this object. Throws
// std::runtime_error when the disk refuses.
class ScratchFile {
 public:
  explicit ScratchFile(std::filesystem::path path);
  ~ScratchFile();
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  std::ostream& stream() { return stream_; }
  void appendTo(std::ostream& out);  // all that was written

 private:
  std::filesystem::path path_;
  std::fstream stream_;
};

}  // namespace fathom
