#pragma once

#include <cstdint>
#include <functional>
#include <random>
#include <span>
#include <vector>

#include "telemetry/link_scheduler.hpp"
#include "telemetry/packet_log.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::monitor {

// A made-up lawnmower dive as the link carries it: for tests of what receives it.
struct SampleDive {
  telemetry::LinkIdentity identity{7, 42};
  std::int64_t start_utc_ns = 1'790'000'000'000'000'000;
  double duration_s = 1200;
  double rate_bps = 300;
  int frame_bytes = 128;
  double loss = 0.1;
  int colour_bits = 3;

  static constexpr double kSpeed_mps = 0.5;
  static constexpr double kLine_m = 40;    // length of a survey line
  static constexpr double kSpacing_m = 4;  // between lines: one tile

  [[nodiscard]] telemetry::Status statusAt(double t) const {
    telemetry::Status s;
    const double way = kSpeed_mps * t;
    const int line = static_cast<int>(way / kLine_m);
    const double along = way - line * kLine_m;
    s.utc_ns = start_utc_ns + static_cast<std::int64_t>(t * 1e9);
    s.north = line % 2 == 0 ? along : kLine_m - along;
    s.east = 2 + line * kSpacing_m;
    s.depth = 20 + 0.1 * s.north + 0.05 * s.east - 2;
    s.heading = line % 2 == 0 ? 0 : 3.14159265;
    s.altitude = 2;
    s.speed = kSpeed_mps;
    s.position_sigma = 0.2 + t / 1000;
    s.pairs_seen = static_cast<std::uint32_t>(2 * t);
    s.pairs_dropped = s.pairs_seen / 50;
    s.map_area = way * 4;
    s.mission_progress = t / duration_s;
    s.health = t > duration_s / 2 ? telemetry::kHealthNoFix : 0;
    return s;
  }

  // Calls send(utc_ns, frame) for each frame that survives the channel.
  void run(const std::function<void(std::int64_t, std::span<const std::uint8_t>)>& send) const {
    telemetry::LinkSchedulerConfig config;
    config.identity = identity;
    config.rate_bps = rate_bps;
    config.frame_bytes = frame_bytes;
    config.loss_rate = loss;
    config.codec.colour_bits = colour_bits;
    telemetry::LinkScheduler scheduler(config);
    scheduler.setMissionInfo({"sirius", {-0.4, 2.65}, start_utc_ns, 0});
    std::mt19937 random(12);
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
    int offered = -1;
    for (double t = 0; t < duration_s; t += 0.5) {
      const telemetry::Status status = statusAt(t);
      const int tile = static_cast<int>(kSpeed_mps * t / 4);
      if (tile != offered) {  // a tile is whole once the vehicle has left it
        if (offered >= 0) scheduler.offer(tileOf(offered));
        offered = tile;
      }
      scheduler.setStatus(status);
      for (std::size_t size; (size = scheduler.nextFrame(status.utc_ns, frame)) > 0;)
        if (random() >= loss * 4294967296.0)
          send(status.utc_ns, std::span<const std::uint8_t>(frame).first(size));
    }
  }

  [[nodiscard]] static HeightTile tileOf(int index) {
    const int per_line = static_cast<int>(kLine_m / 4);
    const int line = index / per_line, along = index % per_line;
    return telemetry::sampleTile(line % 2 == 0 ? along : per_line - 1 - along, line);
  }
};

}  // namespace fathom::monitor
