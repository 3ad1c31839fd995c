#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// Images into img/, each whole under its name or not there at all, whatever happens to the machine: written
// under "<name>.tmp" into blocks taken beforehand, made durable, renamed, and the folder made durable. The
// pages are dropped from the system's cache, so that five hours of images push out nobody's memory. The
// folder is opened by the first image that finds it there.
class ImageWriter {
 public:
  explicit ImageWriter(std::filesystem::path folder) : path_(std::move(folder)) {}
  ~ImageWriter();
  ImageWriter(const ImageWriter&) = delete;
  ImageWriter& operator=(const ImageWriter&) = delete;

  // Writes an image and lets the disk begin with it; false when the disk refuses or a file of that name is
  // there already: nothing is left of it then.
  [[nodiscard]] bool write(const std::string& name, const ImageView& image) noexcept;
  // Waits for the disk to hold all that was written since the last call, and gives the names; on false none
  // of them is there.
  [[nodiscard]] bool commit() noexcept;
  // Why the last image that is not there is not: an errno.
  [[nodiscard]] int error() const noexcept { return error_; }

  [[nodiscard]] std::uint64_t bytes() const noexcept { return bytes_; }  // of committed files

 private:
  struct Pending {
    int fd = -1;
    std::string name;
    std::uint64_t bytes = 0;
  };
  [[nodiscard]] bool refused(int error) noexcept;
  void discard() noexcept;

  std::filesystem::path path_;
  int folder_ = -1;
  int error_ = 0;
  std::vector<Pending> pending_;
  std::uint64_t bytes_ = 0;
};

}  // namespace fathom::io
