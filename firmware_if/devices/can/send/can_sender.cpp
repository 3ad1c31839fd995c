#include "firmware_if/devices/can/send/can_sender.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "firmware_if/devices/can/n2k_definitions.hpp"
#include "firmware_if/devices/can/send/n2k_encoder.hpp"
#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kObjection_ns = 250 * kMillisecond_ns;
// A device that could not claim an address says so after 0 to 153 ms, lest all such send at once.
constexpr std::int64_t kDelayStep_ns = kMillisecond_ns * 6 / 10;
constexpr std::uint8_t kClaimPriority = 6;

constexpr double kNoValue = std::numeric_limits<double>::quiet_NaN();
constexpr std::int64_t kHeartbeat_s = 60;
constexpr unsigned kIdentifiers = 253;  // of reports and heartbeats: 253 to 255 are no numbers
constexpr double kBurst = 40;           // frames that may leave at once: product information and a fix

std::int64_t periodNs(double seconds) {
  return static_cast<std::int64_t>(seconds * static_cast<double>(kSecond_ns));
}

// The nearest of a field's codes, the highest that is a number at most; `unknown` when absent.
std::uint64_t coded(std::optional<double> value, double unit, std::uint64_t largest, std::uint64_t unknown) {
  if (!value || !(*value >= 0)) return unknown;
  return static_cast<std::uint64_t>(std::min(std::round(*value / unit), static_cast<double>(largest)));
}

bool isFastPacket(std::uint32_t pgn) {
  const N2kPgnSpec* spec = findN2kPgn(pgn);
  return spec != nullptr ? spec->fast_packet
                         : pgn == 126464 || pgn == 126996 || pgn >= CanSender::kFirstStatusPgn;
}

}  // namespace

std::uint64_t N2kDeviceName::packed() const noexcept {
  constexpr std::uint64_t kMarine = 4, kArbitraryAddressCapable = 1;
  return (unique_number & 0x1FFFFFU) | std::uint64_t{manufacturer_code & 0x7FFU} << 21 |
         std::uint64_t{device_instance} << 32 | std::uint64_t{function} << 40 |
         std::uint64_t{device_class & 0x7FU} << 49 | kMarine << 60 | kArbitraryAddressCapable << 63;
}

void AddressClaim::start() noexcept {
  taken_.reset();
  if (address_ == kNoAddress) address_ = preferred_;
  due_ = true;
  due_ns_ = 0;
  claimed_ = held_ = false;
}

void AddressClaim::receive(const N2kId& id, std::span<const std::uint8_t> payload,
                           std::int64_t now_ns) noexcept {
  if (id.pgn == kRequestPgn) {
    const bool for_us = id.destination == kEveryone || (id.destination == address_ && address_ != kNoAddress);
    if (for_us && payload.size() >= 3 && readLittleEndian(payload.first(3)) == kAddressClaimPgn && !due_) {
      due_ = true;
      due_ns_ =
          address_ == kNoAddress ? now_ns + static_cast<std::int64_t>(name_ & 0xFF) * kDelayStep_ns : now_ns;
    }
    return;
  }
  if (id.source <= kLastAddress) taken_.set(id.source);
  if (id.pgn != kAddressClaimPgn || payload.size() != 8 || id.source != address_ || address_ == kNoAddress)
    return;
  if (name_ < readLittleEndian(payload)) {
    due_ = true;
    due_ns_ = now_ns;
  } else {
    lose(now_ns);
  }
}

void AddressClaim::lose(std::int64_t now_ns) noexcept {
  ++lost_;
  due_ = true;
  due_ns_ = now_ns;
  claimed_ = held_ = false;
  for (unsigned step = 1; step <= kLastAddress; ++step) {
    const auto next = static_cast<std::uint8_t>((address_ + step) % (kLastAddress + 1U));
    if (taken_.test(next)) continue;
    address_ = next;
    return;
  }
  address_ = kNoAddress;
  due_ns_ += static_cast<std::int64_t>(name_ & 0xFF) * kDelayStep_ns;
}

CanFrame AddressClaim::claim() const noexcept {
  CanFrame out;
  out.id = makeN2kId({kClaimPriority, kAddressClaimPgn, address_, kEveryone});
  out.size = 8;
  writeLittleEndian(out.data, name_);
  return out;
}

void AddressClaim::claimSent(std::int64_t now_ns) noexcept {
  due_ = false;
  // An answer to a request, or to a claim that lost, does not restart the wait.
  if (claimed_ || address_ == kNoAddress) return;
  claimed_ = true;
  claimed_ns_ = now_ns;
}

bool AddressClaim::held(std::int64_t now_ns) noexcept {
  if (claimed_ && now_ns - claimed_ns_ >= kObjection_ns) held_ = true;
  return held_;
}

void CanSender::Config::validate() const {
  const auto need = [](bool good, const char* what) {
    if (!good) throw std::invalid_argument(what);
  };
  need(address <= 251, "address must be 0 to 251");
  for (const double period : {position_period_s, fix_period_s, depth_period_s, status_period_s})
    need(period == 0 || (period >= 0.1 && period <= 3600), "periods must be 0 or 0.1 to 3600 s");
  need(status_pgn >= kFirstStatusPgn && status_pgn <= kLastStatusPgn, "status_pgn must be 130816 to 131071");
  need(frames_per_s > 0, "frames_per_s must be positive");
}

CanSender::CanSender(const Config& config) : config_(config), claim_(config.name.packed(), config.address) {
  config_.validate();
  position_.every_ns = periodNs(config_.position_period_s);
  fix_.every_ns = periodNs(config_.fix_period_s);
  depth_.every_ns = periodNs(config_.depth_period_s);
  status_.every_ns = periodNs(config_.status_period_s);
  heartbeat_.every_ns = kHeartbeat_s * kSecond_ns;
}

void CanSender::start() noexcept {
  claim_.start();
  counts_.dropped += queue_.size();
  queue_.clear();
}

void CanSender::publish(const VehicleReport& report) noexcept {
  report_ = report;
  sid_ = static_cast<std::uint8_t>((sid_ + 1) % kIdentifiers);
}

bool CanSender::due(Period& period, std::int64_t now_ns) noexcept {
  if (period.every_ns == 0 || now_ns < period.next_ns) return false;
  // The period begins now, not when the message was due: missed ones are not sent later.
  period.next_ns = now_ns + period.every_ns;
  return true;
}

void CanSender::send(std::uint8_t priority, std::uint32_t pgn, std::uint8_t destination,
                     std::span<const std::uint8_t> payload, std::int64_t now_ns) noexcept {
  const N2kId id{priority, pgn, claim_.address(), destination};
  std::array<CanFrame, kMaxFastPacketFrames> frames;
  std::size_t count = 1;
  if (isFastPacket(pgn)) {
    count = splitFastPacket(id, sequence_++, payload, frames);
  } else {
    frames[0] = {};
    frames[0].id = makeN2kId(id);
    frames[0].size = static_cast<std::uint8_t>(payload.size());
    std::ranges::copy(payload, frames[0].data.begin());
  }
  if (queue_.size() + count > queue_.capacity()) {
    counts_.dropped += count;
    return;
  }
  for (const CanFrame& frame : std::span(frames).first(count))
    static_cast<void>(queue_.push({frame, now_ns}));
  counts_.queued += count;
}

void CanSender::receive(const CanFrame& frame, std::int64_t now_ns) noexcept {
  const N2kId id = parseN2kId(frame.id);
  const std::uint8_t address = claim_.address();
  claim_.receive(id, frame.bytes(), now_ns);
  if (claim_.address() != address) {
    // What waits bears the address that was lost.
    counts_.dropped += queue_.size();
    queue_.clear();
  }
  if (id.pgn != kRequestPgn || frame.size < 3 || !claim_.held(now_ns)) return;
  if (id.destination != kEveryone && id.destination != claim_.address()) return;
  answer(id, static_cast<std::uint32_t>(readLittleEndian(frame.bytes().first(3))), now_ns);
}

void CanSender::answer(const N2kId& id, std::uint32_t pgn, std::int64_t now_ns) noexcept {
  ++counts_.requests;
  if (pgn == kAddressClaimPgn) return;  // the claim answers
  if (pgn == 126996) return sendProduct(kEveryone, now_ns);
  if (pgn == 126464) return sendLists(id.source, now_ns);
  // A request to everyone that nobody can answer stays unanswered (SAE J1939-21, section 5.4.4).
  if (id.destination == kEveryone) return;
  std::array<std::uint8_t, 8> refusal;
  refusal.fill(0xFF);
  refusal[0] = 1;  // negative acknowledgement
  writeLittleEndian(std::span(refusal).last(3), pgn);
  send(6, 59392, id.source, refusal, now_ns);
}

void CanSender::sendProduct(std::uint8_t destination, std::int64_t now_ns) noexcept {
  constexpr std::size_t kText = 32;
  constexpr std::uint16_t kN2kVersion = 2100;  // of the standard, 2.100
  std::array<std::uint8_t, 134> payload;
  payload.fill(0xFF);
  writeLittleEndian(std::span(payload).first(2), kN2kVersion);
  writeLittleEndian(std::span(payload).subspan(2, 2), 1);  // product code
  const auto text = [&](std::size_t at, std::string_view what) {
    std::memcpy(payload.data() + at, what.data(), std::min(what.size(), kText));
  };
  text(4, "Fathom map of the seafloor");
  text(4 + kText, config_.software_version);
  text(4 + 2 * kText, "1");
  std::array<char, 12> serial{};
  std::snprintf(serial.data(), serial.size(), "%u", static_cast<unsigned>(config_.name.unique_number));
  text(4 + 3 * kText, serial.data());
  payload[132] = 0;  // not certified
  payload[133] = 1;  // load on the bus, 50 mA
  send(6, 126996, destination, payload, now_ns);
}

void CanSender::sendLists(std::uint8_t destination, std::int64_t now_ns) noexcept {
  constexpr std::array<std::uint32_t, 2> kReceived = {59904, 60928};  // and what sensors send
  const auto list = [&](std::uint8_t kind, std::span<const std::uint32_t> pgns, std::uint32_t more) {
    std::array<std::uint8_t, 1 + 3 * (kSentPgns.size() + 1)> payload;
    std::size_t at = 0;
    payload[at++] = kind;
    const auto put = [&](std::uint32_t pgn) {
      writeLittleEndian(std::span(payload).subspan(at, 3), pgn);
      at += 3;
    };
    for (const std::uint32_t pgn : pgns) put(pgn);
    if (more != 0) put(more);
    send(6, 126464, destination, std::span(payload).first(at), now_ns);
  };
  list(0, kSentPgns, config_.status_pgn);
  list(1, kReceived, 0);
}

void CanSender::sendFix(std::int64_t now_ns) noexcept {
  constexpr std::int64_t kDay_s = 86400;
  constexpr double kEstimated = 6;
  const std::int64_t day = report_.utc_ns / (kDay_s * kSecond_ns);
  const double time =
      static_cast<double>(report_.utc_ns % (kDay_s * kSecond_ns)) / static_cast<double>(kSecond_ns);
  const std::array<N2kValue, 7> values = {{{"sid", static_cast<double>(sid_)},
                                           {"days_since_1970", static_cast<double>(day)},
                                           {"time_of_day_s", time},
                                           {"latitude_deg", *report_.latitude * kDegreesPerRadian},
                                           {"longitude_deg", *report_.longitude * kDegreesPerRadian},
                                           {"method", kEstimated},
                                           {"satellites", 0}}};
  std::array<std::uint8_t, 43> payload;  // ends with the number of reference stations
  if (!encodeN2kPayload(129029, values, payload)) return;
  payload.back() = 0;
  send(3, 129029, kEveryone, payload, now_ns);
}

void CanSender::sendStatus(std::int64_t now_ns) noexcept {
  constexpr unsigned kMarine = 4, kLayoutVersion = 1;
  std::array<std::uint8_t, 20> payload;
  const auto put = [&](std::size_t at, std::size_t size, std::uint64_t value) {
    writeLittleEndian(std::span(payload).subspan(at, size), value);
  };
  put(0, 2, (config_.name.manufacturer_code & 0x7FFU) | 3U << 11 | kMarine << 13);
  put(2, 1, kLayoutVersion);
  put(3, 1, coded(report_.mission_progress, 0.005, 200, 0xFF));
  put(4, 4, coded(report_.map_area, 1, 0xFFFFFFFC, 0xFFFFFFFF));
  put(8, 4, report_.pairs_mapped);
  put(12, 4, report_.pairs_dropped);
  put(16, 2, report_.health);
  put(18, 2, coded(report_.sigma_horizontal, 0.01, 0xFFFC, 0xFFFF));
  send(7, config_.status_pgn, kEveryone, payload, now_ns);
}

void CanSender::sendReports(std::int64_t now_ns) noexcept {
  if (due(heartbeat_, now_ns)) {
    // The two controllers of the bus: error active, not there; equipment operational.
    std::array<std::uint8_t, 8> payload = {0, 0, heartbeats_, 0xCC, 0xFF, 0xFF, 0xFF, 0xFF};
    writeLittleEndian(std::span(payload).first(2), kHeartbeat_s * 1000);
    heartbeats_ = static_cast<std::uint8_t>((heartbeats_ + 1) % kIdentifiers);
    send(7, 126993, kEveryone, payload, now_ns);
  }
  if (report_.utc_ns == 0 || now_ns - report_.utc_ns > kReportHolds_s * kSecond_ns) return;
  std::array<std::uint8_t, 8> payload;
  const bool position = report_.latitude && report_.longitude;
  if (position && due(position_, now_ns)) {
    const std::array<N2kValue, 2> values = {{{"latitude_deg", *report_.latitude * kDegreesPerRadian},
                                             {"longitude_deg", *report_.longitude * kDegreesPerRadian}}};
    if (encodeN2kPayload(129025, values, payload)) send(2, 129025, kEveryone, payload, now_ns);
  }
  if (position && due(fix_, now_ns)) sendFix(now_ns);
  if ((report_.depth || report_.altitude) && due(depth_, now_ns)) {
    const std::array<N2kValue, 3> values = {{{"sid", static_cast<double>(sid_)},
                                             {"depth_m", report_.altitude.value_or(kNoValue)},
                                             {"offset_m", report_.depth.value_or(kNoValue)}}};
    if (encodeN2kPayload(128267, values, payload)) send(3, 128267, kEveryone, payload, now_ns);
  }
  if (due(status_, now_ns)) sendStatus(now_ns);
}

const CanFrame* CanSender::next(std::int64_t now_ns) noexcept {
  if (tokens_ns_ != 0)
    tokens_ = std::min(kBurst, tokens_ + config_.frames_per_s * static_cast<double>(now_ns - tokens_ns_) /
                                             static_cast<double>(kSecond_ns));
  tokens_ns_ = now_ns;
  out_is_claim_ = claim_.claimDue(now_ns);
  if (out_is_claim_) {
    if (tokens_ < 0) return nullptr;
    out_ = claim_.claim();
    return &out_;
  }
  if (!claim_.held(now_ns)) return nullptr;
  while (!queue_.empty() && now_ns - queue_.front().since_ns > kFrameHolds_s * kSecond_ns) {
    queue_.popFront();
    ++counts_.dropped;
  }
  sendReports(now_ns);
  if (queue_.empty() || tokens_ < 1) return nullptr;
  out_ = queue_.front().frame;
  return &out_;
}

void CanSender::sent(std::int64_t now_ns) noexcept {
  tokens_ -= 1;
  if (out_is_claim_) {
    claim_.claimSent(now_ns);
  } else {
    queue_.popFront();
  }
}

}  // namespace fathom::io
