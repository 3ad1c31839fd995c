#include "firmware_if/devices/camera/pixel_unpack.hpp"

#include <array>
#include <cstring>

namespace fathom::io {
namespace {

constexpr std::array<WireFormat, 8> kFormats{{
    {"Mono8", 0x01080001, WirePacking::kBytes, PixelFormat::kMono, 8},
    {"Mono12", 0x01100005, WirePacking::kWords12, PixelFormat::kMono, 12},
    {"Mono12Packed", 0x010c0006, WirePacking::kPacked12, PixelFormat::kMono, 12},
    {"Mono12p", 0x010c0047, WirePacking::kBits12, PixelFormat::kMono, 12},
    {"BayerRG8", 0x01080009, WirePacking::kBytes, PixelFormat::kBayerRggb, 8},
    {"BayerRG12", 0x01100011, WirePacking::kWords12, PixelFormat::kBayerRggb, 12},
    {"BayerRG12Packed", 0x010c002b, WirePacking::kPacked12, PixelFormat::kBayerRggb, 12},
    {"BayerRG12p", 0x010c0059, WirePacking::kBits12, PixelFormat::kBayerRggb, 12},
}};

constexpr std::uint16_t k12Bits = 0x0fff;

// Two pixels from three bytes, and the bytes of two pixels.
struct PixelPair {
  std::uint16_t first, second;
};
struct Packed {
  static PixelPair unpack(const std::uint8_t* in) {
    return {static_cast<std::uint16_t>(in[0] << 4 | (in[1] & 0x0f)),
            static_cast<std::uint16_t>(in[2] << 4 | in[1] >> 4)};
  }
  static void pack(PixelPair pair, std::uint8_t* out) {
    out[0] = static_cast<std::uint8_t>(pair.first >> 4);
    out[1] = static_cast<std::uint8_t>((pair.first & 0x0f) | (pair.second & 0x0f) << 4);
    out[2] = static_cast<std::uint8_t>(pair.second >> 4);
  }
};
struct Bits {
  static PixelPair unpack(const std::uint8_t* in) {
    return {static_cast<std::uint16_t>(in[0] | (in[1] & 0x0f) << 8),
            static_cast<std::uint16_t>(in[1] >> 4 | in[2] << 4)};
  }
  static void pack(PixelPair pair, std::uint8_t* out) {
    out[0] = static_cast<std::uint8_t>(pair.first);
    out[1] = static_cast<std::uint8_t>(pair.first >> 8 | (pair.second & 0x0f) << 4);
    out[2] = static_cast<std::uint8_t>(pair.second >> 4);
  }
};

// An odd last pixel takes two bytes.
template <typename Form>
void unpackAll(std::size_t pixels, const std::byte* wire, std::byte* out) {
  const auto* in = reinterpret_cast<const std::uint8_t*>(wire);
  std::size_t i = 0;
  for (; i + 1 < pixels; i += 2, in += 3) {
    const PixelPair pair = Form::unpack(in);
    std::memcpy(out + 2 * i, &pair, sizeof pair);
  }
  if (i == pixels) return;
  const std::uint8_t last[3] = {in[0], in[1], 0};
  const std::uint16_t pixel = Form::unpack(last).first;
  std::memcpy(out + 2 * i, &pixel, sizeof pixel);
}

template <typename Form>
void packAll(std::size_t pixels, const std::byte* frame, std::byte* wire) {
  auto* out = reinterpret_cast<std::uint8_t*>(wire);
  std::size_t i = 0;
  for (; i + 1 < pixels; i += 2, out += 3) {
    PixelPair pair;
    std::memcpy(&pair, frame + 2 * i, sizeof pair);
    Form::pack(pair, out);
  }
  if (i == pixels) return;
  PixelPair pair{0, 0};
  std::memcpy(&pair.first, frame + 2 * i, sizeof pair.first);
  std::uint8_t last[3];
  Form::pack(pair, last);
  std::memcpy(out, last, 2);
}

void maskWords(std::size_t pixels, const std::byte* in, std::byte* out) {
  for (std::size_t i = 0; i < pixels; ++i) {
    std::uint16_t pixel;
    std::memcpy(&pixel, in + 2 * i, sizeof pixel);
    pixel &= k12Bits;
    std::memcpy(out + 2 * i, &pixel, sizeof pixel);
  }
}

}  // namespace

std::span<const WireFormat> wireFormats() {
  return kFormats;
}

std::optional<WireFormat> wireFormat(std::string_view name) {
  for (const WireFormat& format : kFormats)
    if (format.name == name) return format;
  return std::nullopt;
}

std::size_t wireBytes(WirePacking packing, std::size_t pixels) noexcept {
  switch (packing) {
    case WirePacking::kBytes:
      return pixels;
    case WirePacking::kWords12:
      return 2 * pixels;
    case WirePacking::kPacked12:
    case WirePacking::kBits12:
      return pixels + (pixels + 1) / 2;
  }
  return 0;
}

std::size_t frameBytes(WirePacking packing, std::size_t pixels) noexcept {
  return packing == WirePacking::kBytes ? pixels : 2 * pixels;
}

bool unpackPixels(WirePacking packing, std::size_t pixels, std::span<const std::byte> wire,
                  std::span<std::byte> out) noexcept {
  if (wire.size() < wireBytes(packing, pixels) || out.size() < frameBytes(packing, pixels)) return false;
  if (pixels == 0) return true;  // nothing, of nowhere
  switch (packing) {
    case WirePacking::kBytes:
      std::memcpy(out.data(), wire.data(), pixels);
      break;
    case WirePacking::kWords12:
      maskWords(pixels, wire.data(), out.data());
      break;
    case WirePacking::kPacked12:
      unpackAll<Packed>(pixels, wire.data(), out.data());
      break;
    case WirePacking::kBits12:
      unpackAll<Bits>(pixels, wire.data(), out.data());
      break;
  }
  return true;
}

bool packPixels(WirePacking packing, std::size_t pixels, std::span<const std::byte> frame,
                std::span<std::byte> wire) noexcept {
  if (wire.size() < wireBytes(packing, pixels) || frame.size() < frameBytes(packing, pixels)) return false;
  switch (packing) {
    case WirePacking::kBytes:
      std::memcpy(wire.data(), frame.data(), pixels);
      break;
    case WirePacking::kWords12:
      maskWords(pixels, frame.data(), wire.data());
      break;
    case WirePacking::kPacked12:
      packAll<Packed>(pixels, frame.data(), wire.data());
      break;
    case WirePacking::kBits12:
      packAll<Bits>(pixels, frame.data(), wire.data());
      break;
  }
  return true;
}

}  // namespace fathom::io
