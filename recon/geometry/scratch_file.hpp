#pragma once

#include <filesystem>
#include <fstream>
#include <ostream>

namespace fathom {

// A file for what comes last in another, gone with this object. Throws std::runtime_error when the disk
// refuses.
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
