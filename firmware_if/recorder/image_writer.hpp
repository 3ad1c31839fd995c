#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "realtime/base/files/descriptor.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// The head of an uncompressed TIFF. The pixels follow as they are in memory, so that an image goes to the
// disk straight from the camera's block: no copy, no heap, and its size is known before it is written.
// (Deflate of sensor noise saves a quarter of the bytes and takes 80 ms for 1360 x 1024 of 12 bits: a third
// of a core for two cameras at 2 Hz.) TIFF 6.0, strips of whole rows, the machine's little endian.
constexpr std::size_t kTiffHeadBytes = 4096;  // a page, so that the pixels begin on one
using TiffHead = std::array<std::uint8_t, kTiffHeadBytes>;

// `image` is not empty, 8 or 16 bit samples, one channel or RGB.
[[nodiscard]] TiffHead tiffHead(const ImageView& image);
[[nodiscard]] std::size_t rowBytes(const ImageView& image);
[[nodiscard]] std::size_t tiffBytes(const ImageView& image);  // of the whole file

// Images into img/, each whole under its name or not there at all, whatever happens to the machine: written
// under "<name>.tmp" into blocks taken beforehand, synced to the disk, renamed, and the folder synced. The
// pages are dropped from the system's cache, so that five hours of images do not displace other memory. The
// folder is opened by the first image that finds it there.
class ImageWriter {
 public:
  explicit ImageWriter(std::filesystem::path folder) : path_(std::move(folder)) {}
  ~ImageWriter() { discard(); }
  ImageWriter(const ImageWriter&) = delete;
  ImageWriter& operator=(const ImageWriter&) = delete;

  // Writes an image and lets the disk begin with it. False, with nothing left of it, when the disk refuses or
  // a file of that name is there already.
  [[nodiscard]] bool write(const std::string& name, const ImageView& image) noexcept;
  // Waits for the disk to hold all images written since the last call, and gives them their names; false:
  // none of them is there.
  [[nodiscard]] bool commit() noexcept;
  // errno of the last image that was refused.
  [[nodiscard]] int error() const noexcept { return error_; }

  [[nodiscard]] std::uint64_t bytes() const noexcept { return bytes_; }  // of committed files

 private:
  struct Pending {
    Descriptor file;
    std::string name;
    std::uint64_t bytes = 0;
  };
  [[nodiscard]] bool refused(int error) noexcept;
  void discard() noexcept;

  std::filesystem::path path_;
  Descriptor folder_;
  int error_ = 0;
  std::vector<Pending> pending_;
  std::uint64_t bytes_ = 0;
};

}  // namespace fathom::io
