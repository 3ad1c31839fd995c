#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "realtime/kernel/frame_port.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// What a modem is given at once, a modem frame, is either one link frame as it is, or a bundle of them:
//   u8 0xF0, then for each link frame u8 its length less one, and its bytes; a zero byte or the end of the
//   modem frame ends it.
// 0xF0 is a protocol version that no link frame has, and no link frame has one byte, so that a modem which
// sends frames of one size alone may fill them with zeros. A bundle has no check of its own: each link frame
// in it is whole or not, by itself.
inline constexpr std::uint8_t kBundleMark = 0xF0;
inline constexpr std::size_t kBundleHeadBytes = 1, kBundleShareBytes = 1;  // of a bundle; before each frame
inline constexpr std::size_t kMinModemBytes = 64;  // of a modem frame that carries bundles
inline constexpr std::size_t kMaxModemBytes = FramePort::kMaxFrameBytes;

// The link frames of a modem frame, one after the other. The bytes may be anything: a link frame that reaches
// beyond the end is left out, and so is what follows it.
class LinkFrames {
 public:
  explicit LinkFrames(std::span<const std::uint8_t> modem_frame);
  // The next link frame, of at least one byte; nullopt at the end.
  [[nodiscard]] std::optional<std::span<const std::uint8_t>> next();

 private:
  std::span<const std::uint8_t> rest_;
  bool bundle_;
};

// The size of a bundle that ends with zeros, as a modem sends whose frames are of one size; 0 for any other
// modem frame.
[[nodiscard]] std::size_t paddedBytes(std::span<const std::uint8_t> modem_frame);

// Puts link frames into a modem frame that the caller holds, of out.size() bytes at most.
class ModemFrameWriter {
 public:
  // `padded`: always a bundle, filled with zeros to the whole of `out`; otherwise one link frame goes as it
  // is.
  ModemFrameWriter(std::span<std::uint8_t> out, bool padded) : out_(out), padded_(padded) {}
  // Where the next link frame is to be written, before add(); empty where there is no room for another.
  [[nodiscard]] std::span<std::uint8_t> room() const;
  // `size` bytes, 1 to 256, were written there.
  void add(std::size_t size);
  // Of the modem frame if a link frame of `more` bytes were added [B].
  [[nodiscard]] std::size_t bytesWith(std::size_t more) const;
  // The modem frame is done: its size, 0 where nothing was added.
  [[nodiscard]] std::size_t finish();

 private:
  // Where the link frame that comes next begins. The first one stands as it is until there is a second.
  [[nodiscard]] std::size_t place() const;

  std::span<std::uint8_t> out_;
  bool padded_;
  std::size_t frames_ = 0, bytes_ = 0;  // of link frames
};

}  // namespace fathom::telemetry
