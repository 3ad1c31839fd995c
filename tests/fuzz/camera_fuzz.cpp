// Any bytes as a frame's packets, ids and stamps: no pixel beyond its buffer, ids and times that only grow.
#include <cstdlib>
#include <cstring>
#include <vector>

#include "firmware_if/devices/camera/camera_clock_map.hpp"
#include "firmware_if/devices/camera/pixel_unpack.hpp"

namespace {

using namespace fathom::io;

void unpack(const std::uint8_t* data, std::size_t size) {
  const WireFormat& format = wireFormats()[data[0] % wireFormats().size()];
  const std::size_t pixels = data[1];
  const std::vector<std::byte> wire(reinterpret_cast<const std::byte*>(data + 2),
                                    reinterpret_cast<const std::byte*>(data + size));
  std::vector<std::byte> frame(frameBytes(format.packing, pixels));
  const bool fits = wire.size() >= wireBytes(format.packing, pixels);
  if (unpackPixels(format.packing, pixels, wire, frame) != fits) std::abort();
  if (!fits || format.bits == 8) return;
  for (std::size_t i = 1; i < frame.size(); i += 2)
    if ((frame[i] & std::byte{0xf0}) != std::byte{0}) std::abort();  // more than 12 bits
}

void stampsAndIds(const std::uint8_t* data, std::size_t size) {
  FrameIdUnwrap ids;
  CameraClockMap clock(data[0] % 2 == 0 ? CameraClockMap::Mode::kFree : CameraClockMap::Mode::kPtp);
  std::uint64_t last_id = 0;
  std::int64_t last_utc = INT64_MIN, now = 1'800'000'000'000'000'000;
  bool any = false;
  for (std::size_t at = 1; at + 17 <= size; at += 17) {
    std::uint64_t id = 0, stamp = 0;
    std::memcpy(&id, data + at + 1, sizeof id);
    std::memcpy(&stamp, data + at + 9, sizeof stamp);
    now += 1 + data[at] * std::int64_t{10'000'000};
    if (data[at] % 8 == 0)
      clock.addReading(static_cast<std::int64_t>(stamp), now, static_cast<std::int64_t>(id));
    if (data[at] % 8 == 1) clock.reopened(), ids.restart();
    const std::uint64_t unwrapped = ids.add(data[at] % 2 == 0 ? id & 0xffff : id >> 1, data[at]).id;
    // A first id at the very end of 64 bits has nowhere to grow to.
    if (any && unwrapped <= last_id && last_id < UINT64_MAX / 2) std::abort();
    const std::int64_t utc = clock.utcNs(static_cast<std::int64_t>(stamp), now);
    if (any && utc <= last_utc) std::abort();
    last_id = unwrapped;
    last_utc = utc;
    any = true;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  unpack(data, size);
  stampsAndIds(data, size);
  return 0;
}
