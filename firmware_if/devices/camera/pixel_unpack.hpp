#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// Packing of the pixels in the packets of a GigE Vision frame.
enum class WirePacking : std::uint8_t {
  kBytes,     // a byte a pixel
  kWords12,   // a little-endian word a pixel, 12 bits used
  kPacked12,  // "12Packed" of GigE Vision 1: two pixels in 3 bytes, high bits of each in bytes 0 and 2
  kBits12,    // "12p" of the Pixel Format Naming Convention: a stream of 12-bit numbers, low bits first
};

// A pixel format of the GenICam Pixel Format Naming Convention (PFNC 2.4) that a survey camera is used with.
struct WireFormat {
  std::string_view name;   // as the camera's PixelFormat feature has it
  std::uint32_t code = 0;  // as it stands in the leader of a frame
  WirePacking packing = WirePacking::kBytes;
  PixelFormat format = PixelFormat::kMono;
  int bits = 8;
};

// Mono8, Mono12, Mono12Packed, Mono12p, BayerRG8, BayerRG12, BayerRG12Packed, BayerRG12p; no value for
// others.
[[nodiscard]] std::optional<WireFormat> wireFormat(std::string_view name);
[[nodiscard]] std::span<const WireFormat> wireFormats();

// Bytes that so many pixels take in packets, and as CameraFrame has them.
[[nodiscard]] std::size_t wireBytes(WirePacking packing, std::size_t pixels) noexcept;
[[nodiscard]] std::size_t frameBytes(WirePacking packing, std::size_t pixels) noexcept;

// Packets' bytes to 8 bits in bytes or 12 in words. False, and nothing written, when `wire` holds less than
// wireBytes() or `out` less than frameBytes(). Bits beyond the twelfth are dropped.
[[nodiscard]] bool unpackPixels(WirePacking packing, std::size_t pixels, std::span<const std::byte> wire,
                                std::span<std::byte> out) noexcept;
// The inverse, for simulated cameras: `frame` as unpackPixels() gives it. False as above.
[[nodiscard]] bool packPixels(WirePacking packing, std::size_t pixels, std::span<const std::byte> frame,
                              std::span<std::byte> wire) noexcept;

}  // namespace fathom::io
