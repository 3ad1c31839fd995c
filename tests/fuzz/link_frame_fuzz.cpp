// Frames as they come off the modem, and every message inside a frame.
#include <algorithm>
#include <cstdlib>
#include <vector>

#include "telemetry/ship/link_receiver.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"

using namespace fathom::telemetry;

namespace {

void check(bool good) {
  if (!good) std::abort();
}

// Whatever decodes as a track must encode and decode to itself.
void track(std::span<const std::uint8_t> payload) {
  std::array<TrackPoint, kMaxTrackPoints> points, again;
  const std::size_t count = decodeTrack(payload, points);
  if (count == 0) return;
  std::array<std::uint8_t, 4096> buffer;
  const std::size_t size = encodeTrack(std::span<const TrackPoint>(points).first(count), buffer);
  check(size > 0 && decodeTrack(std::span<const std::uint8_t>(buffer).first(size), again) == count);
  for (std::size_t i = 0; i < count; ++i)
    check(points[i].utc_ns == again[i].utc_ns && points[i].north == again[i].north);
}

// A conversation: pieces of the data, each led by its length, as whole frames (a CRC that fits is put under
// them), so that sequence numbers and repair groups come in any order and with any content.
void receive(std::span<const std::uint8_t> data) {
  LinkReceiver receiver(LinkIdentity{1, 1});
  std::array<std::uint8_t, kMaxFrameBytes> frame;
  std::uint64_t delivered = 0;
  while (data.size() > 4) {
    const std::size_t size =
        std::min<std::size_t>(data[0], std::min(data.size() - 4, frame.size() - kFrameOverhead));
    // Few sequence numbers, so that they meet.
    const FrameHeader header{{1, 1},
                             static_cast<std::uint16_t>(data[1] << 12 | (data[2] & 0x7F)),
                             static_cast<MessageType>(data[3] & 7U),
                             (data[3] & 8U) != 0};
    const std::size_t bytes = encodeFrame(header, data.subspan(4, size), frame);
    receiver.accept(std::span<const std::uint8_t>(frame).first(bytes),
                    [&](const LinkReceiver::Message& message) {
                      check(message.type != MessageType::kRepair && message.payload.size() <= kMaxFrameBytes);
                      ++delivered;
                      return message.payload.size() % 2 == 0;
                    });
    const Acknowledgement a = receiver.acknowledgement();
    check(a.reach <= Acknowledgement::kMaxReach && (a.valid || a.reach == 0));
    if (const auto further = receiver.furtherAcknowledgement((size & 1U) != 0)) check(further->valid);
    data = data.subspan(4 + size);
  }
  const LinkReceiver::Counters& c = receiver.counters();
  std::uint64_t sum = 0;
  for (const std::uint64_t n : c.verdicts) sum += n;
  check(sum == c.frames && delivered <= c.frames * kMaxGroup);
}

// A modem frame of any bytes, and as the tail of a bundle, gives pieces inside it.
void bundles(std::span<const std::uint8_t> data) {
  std::vector<std::uint8_t> bundle{kBundleMark};
  bundle.insert(bundle.end(), data.begin(),
                data.begin() + static_cast<std::ptrdiff_t>(std::min(data.size(), kMaxModemBytes - 1)));
  for (const std::span<const std::uint8_t> modem_frame : {data, std::span<const std::uint8_t>(bundle)}) {
    std::size_t sum = 0;
    std::vector<std::uint8_t> again(modem_frame.size() + 1);
    ModemFrameWriter writer(std::span<std::uint8_t>(again).first(modem_frame.size()), true);
    LinkFrames frames(modem_frame);
    while (const auto frame = frames.next()) {
      check(frame->data() >= modem_frame.data() &&
            frame->data() + frame->size() <= modem_frame.data() + modem_frame.size() && !frame->empty());
      sum += frame->size();
      if (modem_frame[0] != kBundleMark) continue;
      check(writer.room().size() >= frame->size());
      std::copy(frame->begin(), frame->end(), writer.room().begin());
      writer.add(frame->size());
    }
    check(sum <= modem_frame.size());
    // What ends with zeros is what the writer makes of its link frames.
    if (paddedBytes(modem_frame) > 0 && sum > 0)
      check(writer.finish() == modem_frame.size() &&
            std::equal(modem_frame.begin(), modem_frame.end(), again.begin()));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::uint8_t> bytes(data, size);
  const DecodedFrame frame = decodeFrame(bytes);
  if (frame.verdict == FrameVerdict::kAccepted) {
    std::array<std::uint8_t, kMaxFrameBytes> out;
    check(encodeFrame(frame.header, frame.payload, out, {}, frame.group.value_or(0)) == size);
    // Frames of protocols before end otherwise.
    if (bytes[0] >> 4 == kProtocolVersion) check(std::equal(bytes.begin(), bytes.end(), out.begin()));
  }
  Status status;
  std::array<std::uint8_t, kStatusBytes> out;
  if (decodeStatus(bytes, status)) check(encodeStatus(status, out) == size);
  StateReport report;
  std::array<std::uint8_t, kStateReportBytes> encoded_again;
  if (decodeStateReport(bytes, report))
    check(encodeStateReport(report, encoded_again) == size &&
          std::equal(bytes.begin(), bytes.end(), encoded_again.begin()));
  MissionInfo info;
  if (decodeMissionInfo(bytes, info)) check(info.vehicle_name.size() <= kMaxNameBytes);
  track(bytes);
  receive(bytes);
  bundles(bytes);
  return 0;
}
