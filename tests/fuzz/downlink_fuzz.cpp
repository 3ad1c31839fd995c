// What the ship says, in every state between noise and a frame with a good signature; and the ship's
// receiver.
#include <algorithm>
#include <cstdlib>

#include "telemetry/downlink/downlink.hpp"
#include "telemetry/ship/ship_link.hpp"

using namespace fathom::telemetry;

namespace {

constexpr LinkIdentity kIdentity{3, 17};
constexpr std::int64_t kStart_ns = 1'790'000'000'000'000'000;

void check(bool good) {
  if (!good) std::abort();
}

const LinkKey& theKey() {
  static const LinkKey key(std::array<std::uint8_t, LinkKey::kBytes>{1, 2, 3});
  return key;
}

// Whatever decodes must encode to the same bytes.
void message(std::span<const std::uint8_t> bytes) {
  DecodedDownlink decoded;
  if (!decodeDownlink(bytes, decoded)) return;
  std::array<std::uint8_t, 512> buffer{};
  if (bytes.size() > buffer.size()) std::abort();
  const std::size_t size = encodeDownlink(decoded.content, decoded.counter, decoded.is_signed,
                                          std::span(buffer).first(bytes.size()));
  check(size == bytes.size() && std::equal(bytes.begin(), bytes.end(), buffer.begin()));
}

void receive(std::span<const std::uint8_t> frame, bool properly_signed) {
  DownlinkReceiver keyed(kIdentity, theKey(), kStart_ns), open(kIdentity, std::nullopt, kStart_ns);
  const auto first = keyed.accept(kStart_ns, frame);
  if (!properly_signed) check(first.verdict != DownlinkVerdict::kAccepted);
  check(first.verdict == DownlinkVerdict::kAccepted || first.content.empty());
  check(keyed.accept(kStart_ns, frame).verdict != DownlinkVerdict::kAccepted);
  check(!open.accept(kStart_ns, frame).content.request);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  message(bytes);
  receive(bytes, false);

  ShipLink ship(std::nullopt, theKey());
  std::array<std::uint8_t, kMaxFrameBytes> out{};
  ship.accept(kStart_ns, bytes, [](const LinkReceiver::Message&) { return true; });
  check(ship.nextFrame(kStart_ns, out) <= kMinFrameBytes);

  // The same bytes as the payload of a whole frame, on a wish with a signature.
  const bool properly_signed = (data[0] & 1U) != 0;
  std::array<std::uint8_t, kMaxFrameBytes> payload{}, frame{};
  const std::size_t room = kMaxFrameBytes - kFrameOverhead - LinkKey::kSignatureBytes;
  std::size_t length = std::min(bytes.size(), room);
  std::copy_n(bytes.begin(), length, payload.begin());
  if (properly_signed) {
    const auto signature = theKey().sign(kIdentity, std::span(payload).first(length));
    std::copy(signature.begin(), signature.end(), payload.begin() + static_cast<std::ptrdiff_t>(length));
    length += signature.size();
  }
  FrameHeader header{.identity = kIdentity, .type = MessageType::kDownlink};
  receive(std::span(frame).first(encodeFrame(header, std::span(payload).first(length), frame)),
          properly_signed);
  return 0;
}
