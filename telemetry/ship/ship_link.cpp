#include "telemetry/ship/ship_link.hpp"

#include <cmath>

#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {
namespace {

// Of so many frames one acknowledges frames further back; all but one, over the whole dive, while the vehicle
// sends no map.
constexpr int kRound = 5;

bool passed(const std::optional<std::int64_t>& since_ns, std::int64_t now_ns, double seconds) {
  return since_ns && static_cast<double>(now_ns - *since_ns) >= seconds * 1e9;
}

}  // namespace

ShipLink::ShipLink(const std::optional<LinkIdentity>& identity, const std::optional<LinkKey>& key,
                   const ShipLinkConfig& config)
    : key_(key), config_(config), receiver_(identity, FrameTag(key)) {
  if (identity) meet(*identity);
}

void ShipLink::meet(const LinkIdentity& identity) {
  if (!sender_) sender_.emplace(identity, key_, config_.frame_bytes);
}

bool ShipLink::receive(std::span<const std::uint8_t> modem_frame, const TakeFrame& take) {
  bool any = false, accepted = false;
  LinkFrames frames(modem_frame);
  while (const auto frame = frames.next()) {
    any = true;
    accepted = take(*frame) || accepted;
  }
  if (!any) return take(modem_frame);
  if (!accepted) return false;
  // A padded modem frame that is full to the last byte does not show its padding.
  if (const std::size_t padded = paddedBytes(modem_frame); padded > 0 || modem_frame.size() != padded_)
    padded_ = padded;
  return true;
}

DecodedFrame ShipLink::accept(std::int64_t now_ns, std::span<const std::uint8_t> frame,
                              const LinkReceiver::Deliver& deliver) {
  const DecodedFrame decoded = receiver_.accept(frame, deliver, now_ns);
  if (decoded.verdict != FrameVerdict::kAccepted) return decoded;
  meet(*receiver_.identity());
  quiet_ns_ = now_ns;
  turn_ns_ = receiver_.turn() ? std::optional(now_ns) : std::nullopt;
  return decoded;
}

std::size_t ShipLink::nextFrame(std::int64_t now_ns, std::int64_t said_ns, std::span<std::uint8_t> out,
                                const Kept& kept) {
  if (!sender_) return 0;
  if (!quiet_ns_) quiet_ns_ = now_ns;
  if (passed(turn_ns_, now_ns, config_.turn_s)) turn_ns_.reset();
  if (!turn_ns_ && !passed(quiet_ns_, now_ns, config_.silence_s)) return 0;
  if (!kept || kept()) {
    constexpr auto kMap = static_cast<std::size_t>(MessageType::kMapPacket);
    const std::uint64_t map_frames = receiver_.counters().types[kMap];
    const bool idle = map_frames == acknowledged_map_frames_;
    const bool look_back = (round_ == kRound - 1) != idle;
    const auto further = look_back ? receiver_.furtherAcknowledgement(idle) : std::nullopt;
    round_ = (round_ + 1) % kRound;
    if (!further) acknowledged_map_frames_ = map_frames;
    sender_->acknowledge(further.value_or(receiver_.acknowledgement()));
  }
  // A frame too long for the vehicle's modem frames is sent without padding.
  const std::size_t bundled = kBundleHeadBytes + kBundleShareBytes + config_.frame_bytes;
  const bool padded = padded_ >= bundled && padded_ <= out.size();
  ModemFrameWriter modem(padded ? out.first(padded_) : out, padded);
  const std::size_t size = sender_->nextFrame(said_ns, modem.room());
  if (size == 0) return 0;
  modem.add(size);
  turn_ns_.reset();
  quiet_ns_ = now_ns;
  return modem.finish();
}

}  // namespace fathom::telemetry
