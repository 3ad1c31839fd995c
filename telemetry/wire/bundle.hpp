#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "realtime/kernel/frame_port.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// A modem frame, which the modem takes at once, is one link frame as it is, or a bundle of link frames:
//   u8 0xF0, then for each link frame u8 its length less one, and its bytes; a zero byte or the end of the
//   modem frame ends it.
// No link frame begins with 0xF0, which is no protocol version, and none has one byte, so that a modem with
// frames of one size may fill them with zeros. A bundle has no check of its own: each link frame in it has
// its tag.
inline constexpr std::uint8_t kBundleMark = 0xF0;
inline constexpr std::size_t kBundleHeadBytes = 1, kBundleShareBytes = 1;  // of a bundle; before each frame
inline constexpr std::size_t kMinModemBytes = 64;  // of a modem frame that carries bundles
inline constexpr std::size_t kMaxModemBytes = FramePort::kMaxFrameBytes;

// Iterates over the link frames of a modem frame of any bytes. It stops at a link frame that reaches beyond
// the end.
class LinkFrames {
 public:
  explicit LinkFrames(std::span<const std::uint8_t> modem_frame);
  // The next link frame, of at least one byte; nullopt at the end.
  [[nodiscard]] std::optional<std::span<const std::uint8_t>> next();

 private:
  std::span<const std::uint8_t> rest_;
  bool bundle_;
};

// Size of a bundle padded with zeros, as modems with frames of one size send it; 0 for any other modem frame.
[[nodiscard]] std::size_t paddedBytes(std::span<const std::uint8_t> modem_frame);

// Writes link frames into a modem frame in the caller's buffer, of out.size() bytes at most.
class ModemFrameWriter {
 public:
  // `padded`: always writes a bundle, filled with zeros to out.size(); otherwise a single link frame is
  // written as it is.
  ModemFrameWriter(std::span<std::uint8_t> out, bool padded) : out_(out), padded_(padded) {}
  // Room for the next link frame, to be written before add(); empty when there is none.
  [[nodiscard]] std::span<std::uint8_t> room() const;
  // Adds the link frame of `size` bytes, 1 to 256, that was written into room().
  void add(std::size_t size);
  // Size of the modem frame with another link frame of `more` bytes [B].
  [[nodiscard]] std::size_t bytesWith(std::size_t more) const;
  // Ends the modem frame and returns its size, 0 when nothing was added.
  [[nodiscard]] std::size_t finish();

 private:
  // Offset of the next link frame. The first one is written without a bundle head until a second is added.
  [[nodiscard]] std::size_t place() const;

  std::span<std::uint8_t> out_;
  bool padded_;
  std::size_t frames_ = 0, bytes_ = 0;  // of link frames
};

}  // namespace fathom::telemetry
