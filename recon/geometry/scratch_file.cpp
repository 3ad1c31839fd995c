#include "recon/geometry/scratch_file.hpp"

#include <stdexcept>
#include <system_error>
#include <utility>

namespace fathom {

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
