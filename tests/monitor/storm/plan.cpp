#include <algorithm>
#include <array>
#include <cmath>

#include "realtime/base/text.hpp"
#include "tests/monitor/storm/plan.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::test {

namespace {

// Drawn apart, so that the rest of a seed's storm stays what it is without.
void drawMore(Plan& p) {
  std::mt19937 random(static_cast<unsigned>(p.up.seed) + 1);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto chance = [&](double share) { return between(0, 1) < share; };
  if (chance(0.3)) {
    p.link.blocks.coarse_spacing = 4 * p.link.blocks.spacing;
    p.link.blocks.coarse_after_s = between(5, 120);
    p.link.blocks.max_squares = p.link.blocks.max_squares * 2;
  }
  p.listener = chance(0.3);
  while (chance(0.3)) {
    const double from_s = between(0.1, 0.8) * p.storm_s;
    p.full_disk.emplace_back(from_s, from_s + between(10, 300));
  }
  double ahead_s = 0;
  std::sort(p.vehicle_restarts.begin(), p.vehicle_restarts.end());
  for (const double at_s : p.vehicle_restarts)
    if (chance(0.5)) p.vehicle_clock.emplace_back(at_s, ahead_s += std::pow(10, between(0, 8)));
  if (p.key && p.answers)
    while (p.requests.size() < 10 && chance(0.7)) p.requests.push_back(between(0.1, 0.95) * p.storm_s);
}

double airSeconds(const Plan& p, int bytes) {
  return p.link.preamble_s + bytes * 8 / p.link.rate_bps;
}

}  // namespace

std::int64_t nanoseconds(double seconds) {
  return std::llround(seconds * 1e9);
}

std::int64_t aheadAt(const std::vector<std::pair<double, double>>& steps, std::int64_t now_ns) {
  double ahead_s = 0;
  for (const auto& [from_s, by_s] : steps)
    if (static_cast<double>(now_ns - kStart_ns) * 1e-9 >= from_s) ahead_s = by_s;
  return nanoseconds(ahead_s);
}

std::optional<telemetry::LinkKey> keyOf(const Plan& plan) {
  constexpr std::array<std::uint8_t, telemetry::LinkKey::kBytes> kSecret{1, 2, 3};
  return plan.key ? std::optional<telemetry::LinkKey>(kSecret) : std::nullopt;
}

Plan draw(std::mt19937& random) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto chance = [&](double share) { return between(0, 1) < share; };
  Plan p;
  constexpr std::array kFrames = {32, 64, 128, 256};
  p.link.identity = kIdentity;
  p.link.first = telemetry::firstVersion(kStart_ns);
  p.link.frame_bytes = kFrames[random() % kFrames.size()];
  p.link.rate_bps = std::exp(between(std::log(80.0), std::log(5400.0)));
  p.link.colour_bits = chance(0.5) ? 3 : 0;
  p.link.max_delay_s = 1;
  p.link.blocks.coarse_spacing = p.link.blocks.spacing;
  p.up.loss = chance(0.2) ? 0 : between(0, 0.5);
  p.up.mean_burst = chance(0.5) ? 0 : between(1, 8);
  p.up.duplicate = chance(0.5) ? 0 : 0.1;
  p.up.corrupt = chance(0.5) ? 0 : 0.1;
  p.up.reorder = chance(0.4) ? 0 : between(0, 0.3);
  p.up.late_s = between(5, 180);
  p.up.delay_s = 0.3;
  p.up.rate_bps = p.link.rate_bps;
  p.up.seed = random();
  p.down = p.up;
  p.down.loss = between(0, 0.5);
  p.down.delay_s += between(0, 0.3);  // the ship's computer
  p.answers = chance(0.8);
  // About as much to send as the link can carry.
  p.side = std::clamp(static_cast<int>(std::sqrt(p.link.rate_bps / 12)), 3, 12);
  const double squares = p.side * p.side;
  p.storm_s = std::clamp(squares * 16 * 25 * 8 / p.link.rate_bps * between(0.5, 2), 300.0, 3000.0);
  p.change_every_s = p.storm_s / (squares * between(1, 4));
  p.step_s = std::clamp(p.link.frame_bytes * 8 / p.link.rate_bps / 3, 0.1, 1.0);
  // Now and then a pool that does not hold the ground.
  p.link.blocks.max_squares = chance(0.25) ? std::max(4, static_cast<int>(squares / 2)) : 2 * p.side * p.side;
  const auto some = [&](double share, std::vector<double>& times) {
    while (chance(share)) times.push_back(between(0.1, 0.95) * p.storm_s);
  };
  some(0.4, p.vehicle_restarts);
  some(0.4, p.ship_restarts);
  some(0.25, p.lost_files);
  some(0.25, p.damaged_files);
  if (chance(0.2)) p.ship_from_s = between(0.2, 0.9) * p.storm_s;
  p.key = chance(0.7);
  p.link.tag = telemetry::FrameTag(keyOf(p));
  while (chance(0.4))
    p.ship_clock.emplace_back(between(0, 1) * p.storm_s, between(-1, 1) * std::pow(10, between(0, 8)));
  std::sort(p.ship_clock.begin(), p.ship_clock.end());
  // Drawn apart, so that the rest of a seed's storm stays what it is without.
  std::mt19937 modems(static_cast<unsigned>(p.up.seed));
  const auto share = [&] { return std::uniform_real_distribution<double>(0, 1)(modems); };
  if (share() < 0.5) {
    constexpr double kLongest_s = 8;
    const int least = std::max(64, p.link.frame_bytes + 2);
    const int most = std::clamp(static_cast<int>(p.link.rate_bps * kLongest_s / 8), least, 2048);
    p.link.modem_bytes = least + static_cast<int>(share() * (most - least));
    p.link.padded = share() < 0.5;
  }
  if (share() < 0.3) p.link.preamble_s = p.up.preamble_s = p.down.preamble_s = share();
  drawMore(p);
  return p;
}

Slowness slowness(const Plan& p) {
  const int full = std::max(p.link.modem_bytes, p.link.frame_bytes);
  const int answer = p.link.padded ? p.link.modem_bytes : 32;
  const auto turn_s = [&](double answer_s) { return 2 * p.link.max_delay_s + answer_s; };
  return {airSeconds(p, full) / (full * 8 / p.link.rate_bps),
          turn_s(airSeconds(p, answer)) / turn_s(32 * 8 / p.link.rate_bps)};
}

std::string describe(const Plan& p) {
  return formatted(
      "%4.0f bit/s, %3d B in %4d%s, preamble %.1f s, loss %.2f in %.1f, late %.2f by %3.0f s, doubled %.1f, "
      "damaged %.1f, %s, %2d x "
      "%2d "
      "squares in %3d, %4.0f s; restarts %zu + %zu, lost %zu, damaged %zu, ship from %4.0f s, %s, clock "
      "steps %zu + %zu, disk full %zu, requests %zu%s%s",
      p.link.rate_bps, p.link.frame_bytes, p.link.modem_bytes, p.link.padded ? " padded" : "",
      p.link.preamble_s, p.up.loss, p.up.mean_burst, p.up.reorder, p.up.late_s, p.up.duplicate, p.up.corrupt,
      p.answers ? "answers" : "silence", p.side, p.side, p.link.blocks.max_squares, p.storm_s,
      p.vehicle_restarts.size(), p.ship_restarts.size(), p.lost_files.size(), p.damaged_files.size(),
      p.ship_from_s, p.key ? "key" : "no key", p.ship_clock.size(), p.vehicle_clock.size(),
      p.full_disk.size(), p.requests.size(), p.listener ? ", a listener" : "",
      p.link.blocks.coarse_spacing > p.link.blocks.spacing ? ", coarse first" : "");
}

std::size_t Ground::change(std::mt19937& random) {
  const auto draw = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const std::size_t at = random() % squares_.size();
  Square& s = squares_[at];
  s.tile.reset();
  for (auto& detail : s.details) detail.reset();
  if (!s.known || s.empty) {
    s.known = true;
    s.empty = false;
    s.seen = draw(0.3, 1);
    s.rise_m = draw(-1, 1);
  } else if (const double what = draw(0, 1); what < 0.3) {
    s.seen = draw(s.seen, 1);
  } else if (what < 0.8) {
    s.rise_m += draw(0, 1) < 0.5 ? draw(0.1, 1) : -draw(0.1, 1);
  } else {
    s.empty = true;
  }
  return at;
}

void Ground::apply(const Square& s, HeightTile& tile) const {
  for (HeightTile::Node& node : tile.nodes) {
    if (!s.known || s.empty) node.coverage = 0;
    node.depth = static_cast<float>(node.depth - s.rise_m);
  }
}

const HeightTile& Ground::tile(std::size_t square) const {
  const Square& s = squares_[square];
  const auto at = static_cast<int>(square);
  if (!s.tile) {
    s.tile = std::make_unique<HeightTile>(telemetry::sampleTile(at / side_, at % side_, kSquare_m, s.seen));
    apply(s, *s.tile);
  }
  return *s.tile;
}

std::optional<std::size_t> Ground::squareAt(double north, double east) const {
  const double n = std::floor(north / kSquare_m), e = std::floor(east / kSquare_m);
  if (n < 0 || e < 0 || n >= side_ || e >= side_) return std::nullopt;
  return static_cast<std::size_t>(static_cast<int>(n) * side_ + static_cast<int>(e));
}

HeightTile Ground::coarse(std::size_t square) const {
  constexpr int kRatio = 4;
  const int row = static_cast<int>(square) / side_ / kRatio,
            column = static_cast<int>(square) % side_ / kRatio;
  HeightTile tile{.north_index = row, .east_index = column, .level = 1, .size = kRatio * kSquare_m};
  for (int n = 0; n < kRatio && row * kRatio + n < side_; ++n)
    for (int e = 0; e < kRatio && column * kRatio + e < side_; ++e) {
      const HeightTile& fine =
          this->tile(static_cast<std::size_t>((row * kRatio + n) * side_ + column * kRatio + e));
      for (int i = 0; i < HeightTile::kCells / kRatio; ++i)
        for (int j = 0; j < HeightTile::kCells / kRatio; ++j)
          tile.at(n * kRatio + i, e * kRatio + j) = fine.at(i * kRatio, j * kRatio);
    }
  return tile;
}

const HeightTile& Ground::detail(std::size_t square, int quarter) const {
  const Square& s = squares_[square];
  const auto at = static_cast<int>(square);
  auto& tile = s.details[static_cast<std::size_t>(quarter)];
  if (!tile) {
    tile = std::make_unique<HeightTile>(
        telemetry::sampleTile(at / side_ * 2 + quarter / 2, at % side_ * 2 + quarter % 2, kSquare_m / 2));
    apply(s, *tile);
  }
  return *tile;
}

}  // namespace fathom::test
