#include "tests/bench/link/survey.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "sim/link/channel.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/ship/ship_link.hpp"

namespace fathom::bench {
namespace {

using telemetry::MessageType;
constexpr std::int64_t kStart_ns = 1'790'000'000'000'000'000;
constexpr double kStep_s = 0.1, kPair_s = 0.5, kLook_s = 1;
constexpr double kInTime_s = 60;
constexpr double kFootprint_m = 1;  // along the track
constexpr int kRatio = 4;           // coarse spacing over fine

struct NodeKey {
  std::int32_t i = 0, j = 0;
  auto operator<=>(const NodeKey&) const = default;
};
struct Times {
  double imaged_s = 0, shown_s = -1, coarse_s = -1;
  float shown_depth = 0;
};

std::int32_t floorDiv(std::int32_t a, std::int32_t b) {
  return a / b - (a % b != 0 && (a < 0) != (b < 0) ? 1 : 0);
}

class Survey {
 public:
  Survey(const SeafloorLattice& seafloor, const SurveyConfig& config)
      : sea_(seafloor),
        config_(config),
        scheduler_(schedulerConfig(config)),
        channel_(up(config), down(config), true),
        ship_(identity(), std::nullopt),
        ear_(identity(), std::nullopt, kStart_ns) {
    scheduler_.setMissionInfo({"sirius", {0.3, -0.2}, kStart_ns, 0});
  }

  SurveyResult run() {
    const double end = config_.survey_s + config_.after_s;
    for (long step = 0; static_cast<double>(step) * kStep_s < end; ++step) {
      now_s_ = static_cast<double>(step) * kStep_s;
      const bool mapping =
          now_s_ < config_.survey_s && !(config_.pause_mapping && now_s_ >= config_.ship_on_s);
      if (mapping && step % std::lround(kPair_s / kStep_s) == 0) image();
      if (step % std::lround(kLook_s / kStep_s) == 0) offer();
      vehicle();
      channel_.advance(now_s_);
      ship();
      if (result_.complete_after_s < 0 && now_s_ > config_.ship_on_s && config_.ship_on_s > 0 &&
          step % 10 == 0 && complete())
        result_.complete_after_s = now_s_ - config_.ship_on_s;
      if (result_.complete_after_s >= 0 && config_.pause_mapping) break;
    }
    return account();
  }

 private:
  static telemetry::LinkIdentity identity() { return {7, 42}; }
  static telemetry::LinkSchedulerConfig schedulerConfig(const SurveyConfig& c) {
    telemetry::LinkSchedulerConfig s = c.scheduler;
    s.identity = identity();
    s.rate_bps = c.rate_bps;
    s.frame_bytes = c.frame_bytes;
    s.colour_bits = c.colour_bits;
    return s;
  }
  static sim::ChannelConfig up(const SurveyConfig& c) {
    sim::ChannelConfig channel;
    channel.loss = c.loss;
    channel.mean_burst = c.mean_burst;
    channel.duplicate = channel.reorder = channel.corrupt = 0;
    channel.delay_s = c.delay_s;
    channel.rate_bps = c.rate_bps;
    channel.seed = c.seed;
    return channel;
  }
  static sim::ChannelConfig down(const SurveyConfig& c) { return up(c); }

  [[nodiscard]] std::int64_t now() const { return kStart_ns + std::llround(now_s_ * 1e9); }

  // Where the vehicle is on its lines, north-south, each a swath east of the one before.
  void position(double& north, double& east) const {
    const double way = now_s_ * config_.speed_mps;
    const int line = static_cast<int>(way / config_.line_m);
    const double along = way - line * config_.line_m;
    north = line % 2 == 0 ? along : config_.line_m - along;
    east = (line + 0.5) * config_.swath_m;
  }

  void image() {
    double north = 0, east = 0;
    position(north, east);
    const double h = sea_.spacing();
    const auto range = [&](double centre, double half) {
      return std::pair(static_cast<std::int32_t>(std::ceil((centre - half) / h)),
                       static_cast<std::int32_t>(std::ceil((centre + half) / h)));
    };
    const auto [i0, i1] = range(north, kFootprint_m / 2);
    const auto [j0, j1] = range(east, config_.swath_m / 2);
    for (std::int32_t i = i0; i < i1; ++i)
      for (std::int32_t j = j0; j < j1; ++j) {
        if (std::isnan(sea_.at(i, j).depth)) continue;
        if (!nodes_.try_emplace({i, j}, Times{now_s_}).second) continue;
        changed_.insert({floorDiv(i, HeightTile::kCells), floorDiv(j, HeightTile::kCells)});
        constexpr int kCoarseCells = HeightTile::kCells * kRatio;
        coarse_changed_.insert({floorDiv(i, kCoarseCells), floorDiv(j, kCoarseCells)});
      }
  }

  void offer() {
    for (const NodeKey& key : changed_) {
      HeightTile tile = tileAt(key, 1);
      for (int i = 0; i < HeightTile::kSide; ++i)
        for (int j = 0; j < HeightTile::kSide; ++j) {
          const std::int32_t gi = key.i * HeightTile::kCells + i, gj = key.j * HeightTile::kCells + j;
          if (!nodes_.contains({gi, gj})) continue;
          tile.at(i, j) = {sea_.at(gi, gj).depth, 0.01F, 1, sea_.at(gi, gj).colour};
        }
      scheduler_.offer(tile, now());
    }
    changed_.clear();
    if (std::fmod(now_s_, 7) > 0.5) return;
    for (const NodeKey& key : coarse_changed_) {
      HeightTile tile = tileAt(key, kRatio);
      for (int i = 0; i < HeightTile::kCells; ++i)
        for (int j = 0; j < HeightTile::kCells; ++j) tile.at(i, j) = mean(key, i, j);
      scheduler_.offer(tile, now());
    }
    coarse_changed_.clear();
  }

  [[nodiscard]] HeightTile tileAt(const NodeKey& key, int ratio) const {
    HeightTile tile;
    tile.north_index = key.i;
    tile.east_index = key.j;
    tile.size = sea_.spacing() * ratio * HeightTile::kCells;
    return tile;
  }

  // A coarse node is the mean of the fine ones nearest to it.
  [[nodiscard]] HeightTile::Node mean(const NodeKey& key, int i, int j) const {
    HeightTile::Node node;
    float depth = 0;
    int n = 0;
    for (int a = -kRatio / 2; a < kRatio / 2; ++a)
      for (int b = -kRatio / 2; b < kRatio / 2; ++b) {
        const std::int32_t gi = (key.i * HeightTile::kCells + i) * kRatio + a;
        const std::int32_t gj = (key.j * HeightTile::kCells + j) * kRatio + b;
        if (!nodes_.contains({gi, gj})) continue;
        depth += sea_.at(gi, gj).depth;
        node.colour = sea_.at(gi, gj).colour;
        ++n;
      }
    if (n == 0) return node;
    node.depth = depth / static_cast<float>(n);
    node.coverage = static_cast<float>(n) / (kRatio * kRatio);
    return node;
  }

  void vehicle() {
    telemetry::Status status;
    status.utc_ns = now();
    position(status.north, status.east);
    status.depth = 20;
    scheduler_.setStatus(status);
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
    while (const std::size_t size = channel_.vehicle().receive(buffer)) {
      const auto heard = ear_.accept(now(), std::span(buffer).first(size));
      if (heard.verdict != telemetry::DownlinkVerdict::kAccepted) continue;
      scheduler_.heard(now());
      if (heard.content.acknowledgement) scheduler_.acknowledge(*heard.content.acknowledgement, now());
    }
    while (const std::size_t size = scheduler_.nextFrame(now(), buffer))
      if (!channel_.vehicle().send(std::span(buffer).first(size))) ++refused_;
  }

  void ship() {
    const bool off = now_s_ >= config_.ship_off_s && now_s_ < config_.ship_on_s;
    if (off)
      ship_ = telemetry::ShipLink(identity(), std::nullopt);  // it will know nothing of what was before
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
    while (const std::size_t size = channel_.ship().receive(buffer)) {
      if (off) continue;
      ship_.accept(now(), std::span(buffer).first(size),
                   [&](const telemetry::LinkReceiver::Message& message) {
                     if (message.type != MessageType::kMapPacket) return true;
                     if (!decoder_.decode(message.payload, packet_)) return false;
                     for (const telemetry::MapBlock& block : packet_.blocks) show(block);
                     return true;
                   });
    }
    if (off) return;
    if (const std::size_t size = ship_.nextFrame(now(), buffer))
      if (!channel_.ship().send(std::span(buffer).first(size))) ++refused_;
  }

  void show(const telemetry::MapBlock& block) {
    const bool fine = std::abs(telemetry::spacingOf(block.key.spacing) - sea_.spacing()) < 1e-9;
    for (int n = 0; n < telemetry::MapBlock::kNodes; ++n) {
      if (!block.isSeen(n)) continue;
      const std::int32_t i = block.key.north * 4 + n / 4, j = block.key.east * 4 + n % 4;
      if (fine) {
        Times& t = nodes_.at({i, j});
        t.shown_depth = block.depth[static_cast<std::size_t>(n)];
        if (t.shown_s < 0) t.shown_s = now_s_;
      } else {
        for (int a = -kRatio / 2; a < kRatio / 2; ++a)
          for (int b = -kRatio / 2; b < kRatio / 2; ++b)
            if (const auto found = nodes_.find({i * kRatio + a, j * kRatio + b});
                found != nodes_.end() && found->second.coarse_s < 0)
              found->second.coarse_s = now_s_;
      }
    }
  }

  [[nodiscard]] bool complete() const {
    return std::all_of(nodes_.begin(), nodes_.end(), [&](const auto& node) {
      return node.second.shown_s >= 0 || node.second.imaged_s > config_.ship_on_s;
    });
  }

  SurveyResult account() {
    const double node_area = sea_.spacing() * sea_.spacing();
    const double last = std::min(now_s_, config_.survey_s);
    double in_time = 0, coarse_in_time = 0, judged = 0, shown = 0;
    std::vector<double> latency;
    for (const auto& [key, t] : nodes_) {
      if (t.shown_s >= 0) {
        ++shown;
        result_.max_error_m = std::max(
            result_.max_error_m, std::abs(static_cast<double>(t.shown_depth - sea_.at(key.i, key.j).depth)));
      }
      if (t.imaged_s > last - kInTime_s && config_.after_s < kInTime_s) continue;
      ++judged;
      const bool here = t.shown_s >= 0 && t.shown_s - t.imaged_s <= kInTime_s;
      in_time += here ? 1 : 0;
      coarse_in_time += here || (t.coarse_s >= 0 && t.coarse_s - t.imaged_s <= kInTime_s) ? 1 : 0;
      latency.push_back(t.shown_s >= 0 ? t.shown_s - t.imaged_s : 1e9);
    }
    std::sort(latency.begin(), latency.end());
    const auto percentile = [&](double p) {
      return latency.empty() ? 0
                             : latency[static_cast<std::size_t>(p * static_cast<double>(latency.size() - 1))];
    };
    result_.counters = scheduler_.counters();
    const auto& c = result_.counters;
    const auto all = static_cast<double>(nodes_.size());
    result_.imaged_m2 = all * node_area;
    result_.judged_m2 = judged * node_area;
    result_.in_time_share = in_time / std::max(judged, 1.0);
    result_.coarse_in_time_share = coarse_in_time / std::max(judged, 1.0);
    result_.shown_share = shown / std::max(all, 1.0);
    result_.p50_s = percentile(0.5);
    result_.p95_s = percentile(0.95);
    result_.bytes_per_m2 = static_cast<double>(c.bytes) / std::max(shown * node_area, 1.0);
    const auto map_frames = static_cast<double>(std::max<std::uint64_t>(c.map_frames, 1));
    result_.bytes_per_map_frame = static_cast<double>(c.map_bytes) / map_frames;
    result_.blocks_per_map_frame = static_cast<double>(c.blocks.sent) / map_frames;
    result_.uplink_loss =
        static_cast<double>(channel_.uplink().counters().lost) /
        static_cast<double>(std::max<std::uint64_t>(channel_.uplink().counters().offered, 1));
    result_.listening_share = 1 - static_cast<double>(c.bytes) * 8 / config_.rate_bps / std::max(now_s_, 1.0);
    result_.downlink_frames = channel_.downlink().counters().offered;
    return result_;
  }

  const SeafloorLattice& sea_;
  SurveyConfig config_;
  telemetry::LinkScheduler scheduler_;
  sim::ChannelPair channel_;
  telemetry::ShipLink ship_;
  telemetry::DownlinkReceiver ear_;
  telemetry::MapPacketDecoder decoder_;
  telemetry::DecodedMapPacket packet_;
  std::map<NodeKey, Times> nodes_;
  std::set<NodeKey> changed_, coarse_changed_;
  double now_s_ = 0;
  std::uint64_t refused_ = 0;
  SurveyResult result_;
};

}  // namespace

SurveyResult runSurvey(const SeafloorLattice& seafloor, const SurveyConfig& config) {
  return Survey(seafloor, config).run();
}

}  // namespace fathom::bench
