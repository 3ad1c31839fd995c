#include "telemetry/downlink/downlink.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/units.hpp"

namespace fathom::telemetry {
namespace {

// An acknowledgement shares a frame with other content only when it still covers this many frames.
constexpr std::size_t kUsefulReach = 48;
constexpr std::size_t kNewestBits = 16;
constexpr std::size_t kBitsPerByte = 8;
constexpr DownlinkCounter kAhead = 6000;  // ten minutes
// The same request within this time is a repetition, later a new request.
constexpr std::int64_t kRepetition_ns = 300 * kSecond_ns;

bool pauses(Request::Kind kind) {
  return kind == Request::Kind::kPauseMap || kind == Request::Kind::kResumeMap;
}

// Whether the newer request replaces the older.
bool makesVoid(const Request& newer, const Request& older) {
  if (newer.kind == Request::Kind::kDetail) return false;
  return newer.kind == older.kind || (pauses(newer.kind) && pauses(older.kind));
}

constexpr std::uint32_t kDownlinkTag = rt::stateTag("DOWN"), kDownlinkVersion = 3;

template <typename Archive, typename R>
void exchangeRequest(Archive& archive, R& r) {
  archive.enumeration(r.kind, static_cast<Request::Kind>(kRequestKinds - 1));
  archive(r.id, r.north_min, r.north_max, r.east_min, r.east_max, r.spacing, r.max_error, r.rate_bps);
}

}  // namespace

DownlinkSender::DownlinkSender(const LinkIdentity& identity, const std::optional<LinkKey>& key,
                               std::size_t frame_bytes)
    : identity_(identity), key_(key), frame_bytes_(frame_bytes) {
  if (frame_bytes < kMinFrameBytes || frame_bytes > kMaxFrameBytes)
    throw std::invalid_argument("a downlink frame must have 32 to 256 bytes");
}

void DownlinkSender::acknowledge(const Acknowledgement& acknowledgement) {
  if (acknowledgement.valid) acknowledgement_ = acknowledgement;
}

bool DownlinkSender::addFix(const UsblFixMessage& fix) {
  if (!validate(fix)) return false;
  fix_ = fix;
  return true;
}

std::optional<std::uint8_t> DownlinkSender::request(Request request) {
  request.id = next_id_;
  if (!validate(request)) return std::nullopt;
  std::erase_if(requests_, [&](const Waiting& w) { return makesVoid(request, w.request); });
  if (requests_.size() >= kMaxRequests) return std::nullopt;
  const auto said =
      std::find_if(requests_.begin(), requests_.end(), [](const Waiting& w) { return w.said > 0; });
  requests_.insert(said, {request, 0});
  next_id_ = static_cast<std::uint8_t>((next_id_ + 1) % kMaxRequests);
  return request.id;
}

void DownlinkSender::confirm(std::uint8_t request_id) {
  std::erase_if(requests_, [&](const Waiting& w) { return w.request.id == request_id && w.said > 0; });
}

bool DownlinkSender::waits(std::uint8_t request_id) const {
  return std::any_of(requests_.begin(), requests_.end(),
                     [&](const Waiting& w) { return w.request.id == request_id; });
}

std::size_t DownlinkSender::payloadRoom() const {
  return frame_bytes_ - kFrameOverhead - (key_ ? LinkKey::kSignatureBytes : 0);
}

bool DownlinkSender::fits(const DownlinkContent& content, std::size_t acknowledgement_bits) const {
  std::array<std::uint8_t, kMaxFrameBytes> scratch{};
  const std::size_t size =
      encodeDownlink(content, counter_, key_.has_value(), std::span(scratch).first(payloadRoom()));
  return size > 0 && (payloadRoom() - size) * kBitsPerByte >= acknowledgement_bits;
}

DownlinkContent DownlinkSender::chooseContent() const {
  DownlinkContent content;
  // An acknowledgement that is due keeps its room, or takes the frame for itself.
  const std::size_t kept = acknowledgement_ && acknowledgement_due_ ? kNewestBits + kUsefulReach : 0;
  const auto addFix = [&] {
    if (fix_ && fits({fix_, content.request, {}}, kept)) content.fix = fix_;
  };
  // A new request comes before a fix, a repetition after it.
  const bool new_request = !requests_.empty() && requests_.front().said == 0;
  if (!new_request) addFix();
  if (!requests_.empty() && fits({content.fix, requests_.front().request, {}}, kept))
    content.request = requests_.front().request;
  if (new_request) addFix();
  if (acknowledgement_ && (content.empty() || fits(content, kNewestBits + kUsefulReach)))
    content.acknowledgement = acknowledgement_;
  return content;
}

void DownlinkSender::noteSaid(const DownlinkContent& content) {
  ++counters_.frames;
  acknowledgement_due_ = acknowledgement_ && !content.acknowledgement;
  if (content.acknowledgement) ++counters_.acknowledgements;
  if (content.fix) {
    ++counters_.fixes;
    fix_.reset();
  }
  if (content.request) {
    ++counters_.requests;
    Waiting said = requests_.front();
    requests_.pop_front();
    if (++said.said < kRepetitions) requests_.push_back(said);
  }
}

std::size_t DownlinkSender::nextFrame(std::int64_t utc_ns, std::span<std::uint8_t> out) {
  if (out.size() < frame_bytes_) return 0;
  const DownlinkCounter before = counter_;
  const DownlinkCounter now = downlinkCounterAt(utc_ns);
  // The counter rises whatever the clock does, unless it was far ahead of it.
  counter_ = counter_ > now && counter_ - now > kAhead ? now : std::max(counter_ + 1, now);
  if (fix_ && !fits({fix_, {}, {}}, 0)) {
    fix_.reset();
    ++counters_.stale_fixes;
  }
  const DownlinkContent content = chooseContent();
  std::array<std::uint8_t, kMaxFrameBytes> payload{};
  std::size_t size =
      encodeDownlink(content, counter_, key_.has_value(), std::span(payload).first(payloadRoom()));
  if (size == 0) {
    counter_ = before;
    return 0;
  }
  if (key_) {
    const LinkKey::Signature signature = key_->sign(identity_, std::span(payload).first(size));
    std::copy(signature.begin(), signature.end(), payload.begin() + static_cast<std::ptrdiff_t>(size));
    size += signature.size();
  }
  FrameHeader header;
  header.identity = identity_;
  header.version = sequence_++;
  header.type = MessageType::kDownlink;
  noteSaid(content);
  return encodeFrame(header, std::span(payload).first(size), out);
}

const char* name(DownlinkVerdict verdict) {
  static constexpr std::array kNames{"accepted", "bad-frame",     "foreign", "bad-payload", "unsigned",
                                     "old",      "bad-signature", "stale",   "no-key"};
  const auto at = static_cast<std::size_t>(verdict);
  return at < kNames.size() ? kNames[at] : "unknown";
}

std::uint64_t DownlinkReceiver::Counters::refused() const {
  return std::accumulate(verdicts.begin(), verdicts.end(), std::uint64_t{0}) -
         (*this)[DownlinkVerdict::kAccepted];
}

DownlinkReceiver::DownlinkReceiver(const LinkIdentity& identity, const std::optional<LinkKey>& key,
                                   std::int64_t not_before_utc_ns)
    : identity_(identity), key_(key), counter_(downlinkCounterAt(not_before_utc_ns)) {}

bool DownlinkReceiver::isRepetition(std::int64_t now_ns, const Request& request) {
  if (request.kind != Request::Kind::kDetail) return false;
  for (const std::optional<RecentDetail>& recent : details_) {
    if (!recent || now_ns - recent->utc_ns >= kRepetition_ns) continue;
    Request same = recent->request;  // a restarted ship numbers its requests from 0 again
    same.id = request.id;
    if (same == request) return true;
  }
  details_[next_detail_++ % details_.size()] = {now_ns, request};
  return false;
}

DownlinkReceiver::Result DownlinkReceiver::judge(std::int64_t now_ns, std::span<const std::uint8_t> frame,
                                                 const SentLately& sent_lately) {
  const DecodedFrame whole = decodeFrame(frame);
  if (whole.verdict != FrameVerdict::kAccepted || whole.header.type != MessageType::kDownlink)
    return {DownlinkVerdict::kBadFrame, {}};
  if (whole.header.identity != identity_) return {DownlinkVerdict::kForeign, {}};
  constexpr std::uint8_t kSignedBit = 0x80;
  const bool is_signed = !whole.payload.empty() && (whole.payload[0] & kSignedBit) != 0;
  if (is_signed && whole.payload.size() < LinkKey::kSignatureBytes) return {DownlinkVerdict::kBadPayload, {}};
  const auto message = whole.payload.first(whole.payload.size() - (is_signed ? LinkKey::kSignatureBytes : 0));
  DecodedDownlink decoded;
  if (!decodeDownlink(message, decoded)) return {DownlinkVerdict::kBadPayload, {}};
  if (!key_) {
    // Without a key any counter may be forged: only a frame's own echo counts as old.
    if (accepted_any_ && decoded.counter == counter_) return {DownlinkVerdict::kOld, {}};
    counter_ = decoded.counter;
  } else {
    if (!is_signed) return {DownlinkVerdict::kUnsigned, {}};
    if (!key_->verify(identity_, message, whole.payload.subspan(message.size())))
      return {DownlinkVerdict::kBadSignature, {}};
    const auto& acknowledgement = decoded.content.acknowledgement;
    const auto lately = acknowledgement && sent_lately ? sent_lately(*acknowledgement) : std::nullopt;
    const double age_s = static_cast<double>(now_ns - downlinkTime(decoded.counter)) / kSecond_ns;
    const bool timely = std::abs(age_s) <= kFresh_s;
    if (!(timely && decoded.counter > counter_) && !(lately && *lately > acknowledged_))
      return {lately || decoded.counter <= counter_ ? DownlinkVerdict::kOld : DownlinkVerdict::kStale, {}};
    if (lately) acknowledged_ = std::max(acknowledged_, *lately);
    if (timely) counter_ = std::max(counter_, decoded.counter);  // a wrong clock does not move the counter
  }
  accepted_any_ = true;
  Result result{DownlinkVerdict::kAccepted, decoded.content, decoded.counter};
  if (!key_ && result.content.request) {
    result.content.request.reset();
    result.verdict = DownlinkVerdict::kNoKey;
  }
  return result;
}

DownlinkReceiver::Result DownlinkReceiver::accept(std::int64_t now_ns, std::span<const std::uint8_t> frame,
                                                  const SentLately& sent_lately) {
  Result result = judge(now_ns, frame, sent_lately);
  ++counters_.verdicts[static_cast<std::size_t>(result.verdict)];
  if (result.content.acknowledgement) ++counters_.acknowledgements;
  if (result.content.fix) ++counters_.fixes;
  if (result.content.request) {
    if (isRepetition(now_ns, *result.content.request)) {
      ++counters_.repeated_requests;
      result.content.request.reset();
    } else {
      ++counters_.requests;
    }
  }
  return result;
}

template <typename Archive, typename Self>
void DownlinkReceiver::exchange(Archive& archive, Self& self) {
  archive(self.counter_, self.accepted_any_, self.acknowledged_, self.counters_, self.next_detail_);
  for (auto& recent : self.details_) {
    bool there = recent.has_value();
    archive(there);
    if constexpr (Archive::kLoading) {
      recent.reset();
      if (there) recent = RecentDetail{};
    }
    if (!there) continue;
    archive.instants(recent->utc_ns);
    exchangeRequest(archive, recent->request);
  }
}

void DownlinkReceiver::save(rt::StateWriter& writer) const {
  writer.section(kDownlinkTag, kDownlinkVersion, [&] { exchange(writer, *this); });
}

bool DownlinkReceiver::load(rt::StateReader& reader) {
  return reader.section(kDownlinkTag, kDownlinkVersion, [&] { exchange(reader, *this); });
}

}  // namespace fathom::telemetry
