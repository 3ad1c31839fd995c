#pragma once

#include <algorithm>
#include <deque>
#include <functional>
#include <random>
#include <set>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/packet_log.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::monitor {

// A synthetic lawnmower dive as the link carries it, for tests of what receives it. Every block is sent
// coarse (1 m) when the vehicle comes near and at 25 cm once it has passed; nothing is repeated. In the
// second half a part of the first lines is sent again, 30 cm deeper.
struct SampleDive {
  telemetry::LinkIdentity identity{7, 42};
  telemetry::FrameTag tag = {};
  std::int64_t start_utc_ns = 1'790'000'000'000'000'000;
  double duration_s = 1200;
  double rate_bps = 300;
  std::size_t frame_bytes = 128;
  double loss = 0.1;
  int colour_bits = 3;
  double line_m = 40;    // length of a survey line
  double spacing_m = 2;  // between lines
  double start_east = 2;

  static constexpr double kSpeed_mps = 0.5;
  static constexpr double kAltitude_m = 2.5;
  static constexpr telemetry::SpacingCode kCoarse = 7, kFine = 5;  // 1 m and 25 cm

  // A reef: a slope with a ridge, coral heads and ripples.
  [[nodiscard]] static double depthAt(double north, double east) {
    const double ridge = 1.8 * std::exp(-std::pow((east - 24 - 6 * std::sin(north / 18)) / 6, 2));
    const double heads = 0.7 * std::pow(std::max(0.0, std::sin(north * 0.45) * std::sin(east * 0.38 + 1)), 3);
    return 20 + 0.03 * north + 0.05 * east - ridge - heads + 0.04 * std::sin(4 * north + 1.5 * east);
  }
  [[nodiscard]] static Rgb colourAt(double north, double east) {
    const double coral = std::max(0.0, std::sin(north * 0.45) * std::sin(east * 0.38 + 1));
    const double shade = 150 + 25 * std::sin(3.1 * north + std::sin(2 * east)) - 40 * coral;
    const auto channel = [](double v) { return static_cast<std::uint8_t>(std::clamp(v, 0.0, 255.0)); };
    return {channel(shade * (0.85 + 0.35 * coral)), channel(shade * (1.0 - 0.25 * coral)),
            channel(shade * (0.8 - 0.1 * coral))};
  }

  [[nodiscard]] telemetry::Status statusAt(double t) const {
    telemetry::Status s;
    const double path = kSpeed_mps * t;
    const int line = static_cast<int>(path / line_m);
    const double along = path - line * line_m;
    s.utc_ns = start_utc_ns + static_cast<std::int64_t>(t * 1e9);
    s.north = line % 2 == 0 ? along : line_m - along;
    s.east = start_east + line * spacing_m;
    s.depth = depthAt(s.north, s.east) - kAltitude_m;
    s.heading = line % 2 == 0 ? 0 : 3.14159265;
    s.altitude = kAltitude_m;
    s.speed = kSpeed_mps;
    s.position_sigma = 0.2 + t / 4000;
    s.battery = std::max(0.1, 0.96 - t / 24000);
    s.pairs_seen = static_cast<std::uint32_t>(2 * t);
    s.pairs_dropped = s.pairs_seen / 50;
    s.map_area = path * spacing_m;
    s.mission_progress = t / duration_s;
    s.health = t > duration_s / 2 ? telemetry::kHealthNoFix : 0;
    return s;
  }

  [[nodiscard]] telemetry::MapBlock blockOf(telemetry::BlockKey key, double shift = 0) const {
    telemetry::MapBlock block{.key = key, .seen = 0xFFFF, .sigma = 0.02F};
    const double spacing = telemetry::spacingOf(key.spacing);
    for (int n = 0; n < telemetry::MapBlock::kNodes; ++n) {
      const double north = (4 * key.north + n / 4) * spacing, east = (4 * key.east + n % 4) * spacing;
      block.depth[static_cast<std::size_t>(n)] = static_cast<float>(depthAt(north, east) + shift);
      block.colour[static_cast<std::size_t>(n)] = colourAt(north, east);
    }
    return block;
  }

  // What survives the channel.
  [[nodiscard]] std::vector<telemetry::Packet> packets() const {
    std::vector<telemetry::Packet> all;
    run([&](std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
      all.push_back({utc_ns, {frame.begin(), frame.end()}});
    });
    return all;
  }
  // Calls send(utc_ns, frame) for each frame that survives the channel.
  void run(const std::function<void(std::int64_t, std::span<const std::uint8_t>)>& send) const {
    telemetry::MapPacketEncoder encoder;
    std::mt19937 random(12);
    telemetry::Version version = telemetry::firstVersion(start_utc_ns);
    std::int64_t now = 0;
    double budget = 0;  // bytes
    const auto frame = [&](telemetry::MessageType type, std::span<const std::uint8_t> payload) {
      std::array<std::uint8_t, telemetry::kMaxFrameBytes> bytes;
      const std::size_t size =
          telemetry::encodeFrame({identity, version++, type, false}, payload, bytes, tag);
      budget -= static_cast<double>(size);
      if (random() >= loss * 4294967296.0) send(now, std::span<const std::uint8_t>(bytes).first(size));
    };
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> out;
    const std::size_t room = frame_bytes - telemetry::kFrameOverhead;
    std::set<telemetry::BlockKey> offered;
    std::deque<telemetry::MapBlock> coarse, fine;
    std::vector<telemetry::TrackPoint> track;
    bool moved = false;
    for (double t = 0; t < duration_s; t += 0.5) {
      const telemetry::Status s = statusAt(t);
      now = s.utc_ns;
      budget = std::min(budget + rate_bps / 16, 2.0 * static_cast<double>(frame_bytes));
      if (std::fmod(t, 5) == 0) track.push_back({s.utc_ns, s.north, s.east, s.depth});
      if (std::fmod(t, 10) == 0)
        frame(telemetry::MessageType::kStatus,
              std::span<const std::uint8_t>(out).first(telemetry::encodeStatus(s, out)));
      if (std::fmod(t, 30) == 0)
        frame(telemetry::MessageType::kTrack, std::span<const std::uint8_t>(out).first(telemetry::encodeTrack(
                                                  track, std::span<std::uint8_t>(out).first(room))));
      if (std::fmod(t, 120) == 0)
        frame(telemetry::MessageType::kMissionInfo,
              std::span<const std::uint8_t>(out).first(
                  telemetry::encodeMissionInfo({"sirius", {-0.4, 2.65}, start_utc_ns, 0}, out)));
      const auto square = [](double v, double size) {
        return static_cast<std::int32_t>(std::floor(v / size));
      };
      const telemetry::BlockKey wide{kCoarse, square(s.north, 4), square(s.east, 4)};
      if (offered.insert(wide).second) coarse.push_back(blockOf(wide));
      for (const double side : {-0.8, 0.0, 0.8}) {
        const telemetry::BlockKey here{kFine, square(s.north, 1), square(s.east + side, 1)};
        if (offered.insert(here).second) fine.push_back(blockOf(here));
      }
      if (!moved && t > 0.6 * duration_s) {
        moved = true;
        for (std::int32_t n = 8; n < 20; ++n)
          for (std::int32_t e = 2; e < 6; ++e)
            if (offered.count({kFine, n, e}) > 0) fine.push_front(blockOf({kFine, n, e}, 0.3));
      }
      while (budget > 0 && !(coarse.empty() && fine.empty())) {
        auto& queue = coarse.empty() ? fine : coarse;
        std::vector<telemetry::MapBlock> blocks(
            queue.begin(), queue.begin() + std::min<std::ptrdiff_t>(std::ssize(queue), 16));
        const auto packed =
            encoder.encode(blocks, {0.05, colour_bits}, std::span<std::uint8_t>(out).first(room));
        if (packed.blocks == 0) break;
        queue.erase(queue.begin(), queue.begin() + static_cast<std::ptrdiff_t>(packed.blocks));
        frame(telemetry::MessageType::kMapPacket, std::span<const std::uint8_t>(out).first(packed.bytes));
      }
    }
  }
};

// A rough seafloor, smooth enough for centimetres between neighbouring nodes.
inline double syntheticDepth(double north, double east) {
  return 20 + 0.1 * north + 0.05 * east + 0.6 * std::sin(north * 0.7) * std::cos(east * 0.5);
}

inline telemetry::MapBlock syntheticBlock(telemetry::SpacingCode code, std::int32_t north, std::int32_t east,
                                          double shift = 0) {
  telemetry::MapBlock block{.key = {code, north, east}, .seen = 0xFFFF, .sigma = 0.02F};
  const double spacing = telemetry::spacingOf(code);
  for (int i = 0; i < telemetry::MapBlock::kSide; ++i) {
    for (int j = 0; j < telemetry::MapBlock::kSide; ++j) {
      const auto n = static_cast<std::size_t>(i * telemetry::MapBlock::kSide + j);
      const double at_north = (4.0 * north + i) * spacing, at_east = (4.0 * east + j) * spacing;
      block.depth[n] = static_cast<float>(syntheticDepth(at_north, at_east) + shift);
      block.colour[n] = {static_cast<std::uint8_t>(100 + 10 * i), static_cast<std::uint8_t>(50 + 10 * j), 40};
    }
  }
  return block;
}

inline constexpr telemetry::SpacingCode kQuarterMetre = 5, kHalfMetre = 6, kMetre = 7;

}  // namespace fathom::monitor
