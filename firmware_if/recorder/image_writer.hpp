#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// Images into img/, each whole under its name or not there at all, whatever happens to the machine: written
// under "<name>.tmp" into blocks taken beforehand, made durable, renamed, and the folder made durable. The
// pages are dropped from the system's cache, so that five hours of images push out nobody's memory.
class ImageWriter {
 public:
  // Throws InputError when the folder cannot be opened.
  explicit ImageWriter(const std::filesystem::path& folder);
  ~ImageWriter();
  ImageWriter(const ImageWriter&) = delete;
  ImageWriter& operator=(const ImageWriter&) = delete;

  // Writes an image and lets the disk begin with it; false when the disk refuses or a file of that name is
  // there already: nothing is left of it then.
  [[nodiscard]] bool write(const std::string& name, const ImageView& image) noexcept;
  // Waits for the disk to hold all that was written since the last call, and gives the names; on false none
  // of them is there.
  [[nodiscard]] bool commit() noexcept;

  [[nodiscard]] std::uint64_t bytes() const noexcept { return bytes_; }  // of committed files

 private:
  struct Pending {
    int fd = -1;
    std::string name;
    std::uint64_t bytes = 0;
  };
  void discard() noexcept;

  int folder_ = -1;
  std::vector<Pending> pending_;
  std::uint64_t bytes_ = 0;
};

}  // namespace fathom::io
