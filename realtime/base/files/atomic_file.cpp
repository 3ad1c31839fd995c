#include "realtime/base/files/atomic_file.hpp"

#include <stdexcept>
#include <system_error>
#include <utility>

namespace fathom {

AtomicFile::AtomicFile(std::filesystem::path path)
    : path_(std::move(path)), temporary_(path_.string() + ".tmp"), stream_(temporary_, std::ios::binary) {
  if (!stream_) throw std::runtime_error("cannot write " + temporary_.string());
}

AtomicFile::~AtomicFile() {
  if (committed_) return;
  stream_.close();
  std::error_code ignored;
  std::filesystem::remove(temporary_, ignored);
}

void AtomicFile::commit() {
  stream_.close();
  if (stream_.fail()) throw std::runtime_error("cannot write " + temporary_.string() + " (disk full?)");
  std::filesystem::rename(temporary_, path_);
  committed_ = true;
}

void writeFile(const std::filesystem::path& path, std::string_view contents) {
  AtomicFile file(path);
  file.stream() << contents;
  file.commit();
}

void writeFile(const std::filesystem::path& path, std::span<const std::uint8_t> contents) {
  writeFile(path, std::string_view(reinterpret_cast<const char*>(contents.data()), contents.size()));
}

ScratchFile::ScratchFile(std::filesystem::path path)
    : path_(std::move(path)),
      stream_(path_, std::ios::in | std::ios::out | std::ios::binary | std::ios::trunc) {
  if (!stream_) throw std::runtime_error("cannot write " + path_.string());
}

ScratchFile::~ScratchFile() {
  stream_.close();
  std::error_code ignored;
  std::filesystem::remove(path_, ignored);
}

void ScratchFile::appendTo(std::ostream& out) {
  stream_.flush();
  if (!stream_) throw std::runtime_error("cannot write " + path_.string() + " (disk full?)");
  if (stream_.tellp() == 0) return;
  stream_.seekg(0);
  out << stream_.rdbuf();
}

}  // namespace fathom
