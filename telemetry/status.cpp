#include "telemetry/status.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fathom::telemetry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr std::int64_t kTenth_ns = 100'000'000;

unsigned navigationBits() {
  using namespace schema;
  return kTime.bits() + 2 * kHorizontal.bits() + kDepth.bits() + kRoll.bits() + kPitch.bits() +
         kHeading.bits() + kAltitude.bits() + kSpeed.bits() + kPositionSigma.bits();
}

unsigned healthBits() {
  using namespace schema;
  return 3 * kPairs.bits() + kTiles.bits() + kArea.bits() + kProgress.bits() + kHealth.bits() +
         3 * kCounter.bits();
}

double headingDegrees(double radians) {
  const double turned = std::fmod(radians / kDegree, 360.0);
  const double degrees = turned < 0 ? turned + 360 : turned;
  return degrees >= 359.75 ? 0 : degrees;  // the half step below 360 rounds to north
}

}  // namespace

const char* healthText(unsigned bit) {
  static constexpr const char* kTexts[kHealthBits] = {
      "soft real time",  "DVL lost",    "compass lost",       "depth lost",    "camera lost",
      "no position fix", "overload",    "pool full",          "map coarsened", "recorder failed",
      "disk low",        "poor stereo", "sensor contradicted"};
  return bit < kHealthBits ? kTexts[bit] : "unknown";
}

std::uint64_t timeToLink(std::int64_t utc_ns) {
  const std::int64_t since = utc_ns - schema::kTimeEpoch_s * 1'000'000'000;
  if (since <= 0) return 0;
  return std::min<std::uint64_t>(static_cast<std::uint64_t>((since + kTenth_ns / 2) / kTenth_ns),
                                 schema::kTime.lastCode());
}

std::int64_t timeFromLink(std::uint64_t code) {
  return schema::kTimeEpoch_s * 1'000'000'000 + static_cast<std::int64_t>(code) * kTenth_ns;
}

std::size_t statusBytes(StatusPart part) {
  const unsigned bits = (part != StatusPart::kHealth ? navigationBits() : 0) +
                        (part != StatusPart::kNavigation ? healthBits() : 0);
  return (bits + 7) / 8;
}

std::size_t encodeStatus(const Status& s, StatusPart part, std::span<std::uint8_t> out) {
  using namespace schema;
  BitWriter w(out);
  if (part != StatusPart::kHealth) {
    w.put(timeToLink(s.utc_ns), kTime.bits());
    w.put(kHorizontal, s.north);
    w.put(kHorizontal, s.east);
    w.put(kDepth, s.depth);
    w.put(kRoll, s.roll / kDegree);
    w.put(kPitch, s.pitch / kDegree);
    w.put(kHeading, headingDegrees(s.heading));
    w.put(kAltitude, s.altitude);
    w.put(kSpeed, s.speed);
    w.put(kPositionSigma, s.position_sigma);
  }
  if (part != StatusPart::kNavigation) {
    w.put(kPairs, s.pairs_seen);
    w.put(kPairs, s.pairs_used);
    w.put(kPairs, s.pairs_dropped);
    w.put(kTiles, s.map_tiles);
    w.put(kArea, s.map_area);
    w.put(kProgress, s.mission_progress);
    w.put(s.health & ((1U << kHealthBits) - 1), kHealth.bits());
    w.put(kCounter, s.slipped_cycles);
    w.put(kCounter, s.shed_work);
    w.put(kCounter, s.pool_refusals);
  }
  return w.ok() ? w.bytes() : 0;
}

bool decodeStatus(std::span<const std::uint8_t> payload, StatusPart part, Status& status) {
  using namespace schema;
  Status s = status;
  BitReader r(payload);
  if (part != StatusPart::kHealth) {
    s.utc_ns = timeFromLink(r.get(kTime.bits()));
    s.north = r.get(kHorizontal);
    s.east = r.get(kHorizontal);
    s.depth = r.get(kDepth);
    s.roll = r.get(kRoll) * kDegree;
    s.pitch = r.get(kPitch) * kDegree;
    s.heading = r.get(kHeading) * kDegree;
    s.altitude = r.get(kAltitude);
    s.speed = r.get(kSpeed);
    s.position_sigma = r.get(kPositionSigma);
  }
  if (part != StatusPart::kNavigation) {
    const auto count = [&](const Field& field) {
      const double value = r.get(field);
      return std::isnan(value) ? 0U : static_cast<std::uint32_t>(value);
    };
    s.pairs_seen = count(kPairs);
    s.pairs_used = count(kPairs);
    s.pairs_dropped = count(kPairs);
    s.map_tiles = count(kTiles);
    s.map_area = r.get(kArea);
    s.mission_progress = r.get(kProgress);
    s.health = static_cast<std::uint16_t>(count(kHealth));
    s.slipped_cycles = count(kCounter);
    s.shed_work = count(kCounter);
    s.pool_refusals = count(kCounter);
  }
  if (!r.ok() || !r.finished()) return false;
  status = s;
  return true;
}

bool validate(const Status& s) {
  using namespace schema;
  const double seconds = static_cast<double>(s.utc_ns) * 1e-9 - static_cast<double>(kTimeEpoch_s);
  return kTime.valid(seconds) && kHorizontal.valid(s.north) && kHorizontal.valid(s.east) &&
         kDepth.valid(s.depth) && kRoll.valid(s.roll / kDegree) && kPitch.valid(s.pitch / kDegree) &&
         std::isfinite(s.heading) && kAltitude.valid(s.altitude) && kSpeed.valid(s.speed) &&
         kPositionSigma.valid(s.position_sigma) && kPairs.valid(s.pairs_seen) && kPairs.valid(s.pairs_used) &&
         kPairs.valid(s.pairs_dropped) && kTiles.valid(s.map_tiles) && kArea.valid(s.map_area) &&
         kProgress.valid(s.mission_progress) && s.health < 1U << kHealthBits &&
         kCounter.valid(s.slipped_cycles) && kCounter.valid(s.shed_work) && kCounter.valid(s.pool_refusals);
}

}  // namespace fathom::telemetry
