#include "tests/monitor/storm/storm.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <optional>

#include "realtime/kernel/text.hpp"
#include "telemetry/map/map_packet.hpp"
#include "tests/monitor/storm/ends.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {
namespace {

using telemetry::BlockKey;
using telemetry::MapBlock;

constexpr double kQuiet_s = 600;  // the ship has turns enough to say what it lacks
constexpr std::size_t kStepsBetweenLooks = 97;

// What the vehicle's frames carried, and whether it held that when they left; and whether the ships show it.
class Witness {
 public:
  explicit Witness(const Ground& ground) : ground_(ground) {}

  void sent(std::span<const std::uint8_t> frame) {
    const telemetry::DecodedFrame whole = telemetry::peekFrame(frame);
    if (whole.header.type != telemetry::MessageType::kMapPacket || !decoder_.decode(whole.payload, packet_))
      return;
    auto& carried = carried_[whole.header.sequence()];
    carried.clear();
    for (const MapBlock& block : packet_.blocks) {
      carried[block.key] = block;
      for (int n = 0; n < MapBlock::kNodes; ++n) {
        const auto true_m = depthAt(block.key, n);
        if (block.isSeen(n) && !(true_m && std::abs(block.depth[static_cast<std::size_t>(n)] - *true_m) <=
                                               packet_.max_error + 0.001))
          ++untrue_;
      }
    }
  }
  void look(const monitor::BlockStore& shown) {
    for (const auto& [place, chunk] : shown.chunks())
      for (const auto& level : chunk->levels)
        for (const auto& [slot, stored] : level) {
          const auto& carried = carried_[static_cast<std::uint16_t>(stored.version)];
          const auto block = carried.find(stored.block.key);
          if (block == carried.end() || block->second.seen != stored.block.seen) {
            ++wrong_;
            continue;
          }
          for (int n = 0; n < MapBlock::kNodes; ++n) {
            const auto k = static_cast<std::size_t>(n);
            if (stored.block.isSeen(n) && stored.block.depth[k] != block->second.depth[k]) {
              ++wrong_;
              break;
            }
          }
        }
  }
  // The vehicle's map at a node of any of the link's lattices; nothing where it has seen nothing.
  [[nodiscard]] std::optional<double> depthAt(const BlockKey& key, int node) const {
    const double spacing = telemetry::spacingOf(key.spacing);
    const int north = key.north * 4 + node / 4, east = key.east * 4 + node % 4;
    const auto square = ground_.squareAt(north * spacing, east * spacing);
    if (!square) return std::nullopt;
    const int across = static_cast<int>(std::lround(Ground::kSquare_m / spacing));
    HeightTile::Node at;
    if (across >= HeightTile::kCells) {
      const int i = north % across, j = east % across, half = across / 2;
      at = across == HeightTile::kCells
               ? ground_.tile(*square).at(i, j)
               : ground_.detail(*square, i / half * 2 + j / half).at(i % half, j % half);
    } else {
      const int stride = HeightTile::kCells / across;
      at = ground_.tile(*square).at(north % across * stride, east % across * stride);
    }
    return at.coverage > 0 ? std::optional<double>(at.depth) : std::nullopt;
  }
  [[nodiscard]] std::size_t wrong() const { return wrong_; }
  [[nodiscard]] std::size_t untrue() const { return untrue_; }

 private:
  const Ground& ground_;
  telemetry::MapPacketDecoder decoder_;
  telemetry::DecodedMapPacket packet_;
  std::map<std::uint16_t, std::map<BlockKey, MapBlock>> carried_;  // by the frame's sequence number
  std::size_t wrong_ = 0, untrue_ = 0;
};

telemetry::Request wishOf(const Plan& plan, std::mt19937& random) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  telemetry::Request request;
  request.kind = static_cast<telemetry::Request::Kind>(random() % telemetry::kRequestKinds);
  request.rate_bps = std::max(80.0, plan.link.rate_bps * between(0.5, 1));
  request.north_min = between(0, plan.side * Ground::kSquare_m - 1);
  request.east_min = between(0, plan.side * Ground::kSquare_m - 1);
  request.north_max = request.north_min + between(0.2, 3);
  request.east_max = request.east_min + between(0.2, 3);
  request.spacing = 0.125;
  request.max_error = random() % 2 == 0 ? 0.05 : 0.03;
  return request;
}

// Counts of nodes that the ship shows otherwise than the vehicle holds them.
struct Differences {
  std::size_t nodes = 0, missing = 0, stale = 0, ghosts = 0;
};
Differences compare(const Ground& ground, const monitor::BlockStore& shown,
                    const telemetry::BlockQueueConfig& config, const Witness& witness) {
  // What is sent again only beyond update_error may be off by that and half a step of the wire's.
  const double bound = config.update_error + 0.001;
  Differences d;
  for (std::size_t s = 0; s < ground.size(); ++s) {
    if (!ground.known(s)) continue;
    const HeightTile tile = ground.tile(s);
    for (int i = 0; i < HeightTile::kCells; ++i)
      for (int j = 0; j < HeightTile::kCells; ++j) {
        const BlockKey key{*telemetry::spacingCode(tile.spacing()), tile.north_index * 4 + i / 4,
                           tile.east_index * 4 + j / 4};
        const monitor::StoredBlock* block = shown.find(key);
        const int n = i % 4 * 4 + j % 4;
        const bool is_shown = block != nullptr && block->block.isSeen(n);
        const bool is_true = tile.at(i, j).coverage > 0;
        d.nodes += is_true ? 1 : 0;
        if (is_true && !is_shown) ++d.missing;
        if (!is_true && is_shown) ++d.ghosts;
        if (is_true && is_shown &&
            !(std::abs(block->block.depth[static_cast<std::size_t>(n)] - tile.at(i, j).depth) <= bound))
          ++d.stale;
      }
  }
  // Of the other lattices, what is shown must be true.
  const auto fine = *telemetry::spacingCode(config.spacing);
  for (const auto& [place, chunk] : shown.chunks())
    for (telemetry::SpacingCode code = 0; code < chunk->levels.size(); ++code)
      for (const auto& [slot, stored] : chunk->levels[code])
        for (int n = 0; n < MapBlock::kNodes && code != fine; ++n) {
          if (!stored.block.isSeen(n)) continue;
          const auto true_m = witness.depthAt(stored.block.key, n);
          if (!true_m) ++d.ghosts;
          if (true_m && !(std::abs(stored.block.depth[static_cast<std::size_t>(n)] - *true_m) <= bound))
            ++d.stale;
        }
  return d;
}

// Whether the ship shows the content of a block that the vehicle has on record as delivered.
bool agree(const monitor::StoredBlock* shown, telemetry::Version first, telemetry::Version last,
           const MapBlock& held) {
  if (shown == nullptr || held.seen == 0) return (shown == nullptr) == (held.seen == 0);
  const auto number = static_cast<std::uint16_t>(shown->version);
  const telemetry::Version version = telemetry::versionNear(number, last);
  // A later one was sent in the moment that the vehicle's log lacks, and carried the same.
  if (version < first || shown->block.seen != held.seen) return false;
  for (int n = 0; n < MapBlock::kNodes; ++n) {
    const auto k = static_cast<std::size_t>(n);
    if (held.isSeen(n) && !(std::abs(shown->block.depth[k] - held.depth[k]) <= 0.102)) return false;
  }
  return true;
}

}  // namespace

StormResult storm(unsigned seed) {
  std::mt19937 random(seed);
  Plan plan = draw(random);
  StormResult result;
  result.what = describe(plan);
  const TemporaryFolder folder;
  Vehicle vehicle(plan);
  Ship ship(plan, folder.path() / "ship");
  auto water = std::make_unique<sim::ChannelPair>(plan.up, plan.down, true);
  Ground ground(plan.side);
  const auto listener = plan.listener ? std::make_unique<Ship>(plan, folder.path() / "listener") : nullptr;
  if (listener) listener->start();
  Witness witness(ground);
  std::mt19937 wishes(seed);

  std::size_t steps = 0;
  const auto step = [&](std::int64_t now_ns, bool stormy) {
    const double before_s = static_cast<double>(now_ns - kStart_ns) * 1e-9 - plan.step_s,
                 now_s = before_s + plan.step_s;
    const auto passed = [&](double at_s) { return at_s > before_s && at_s <= now_s; };
    const auto any = [&](const std::vector<double>& times) {
      return stormy && std::any_of(times.begin(), times.end(), passed);
    };
    if (any(plan.vehicle_restarts) && !vehicle.restart(now_ns, ground))
      result.wrong.emplace_back("a state does not load");
    if (!ship.on() && now_s >= plan.ship_from_s) ship.start();
    if (ship.on()) {
      const bool lost = any(plan.lost_files), damaged = any(plan.damaged_files);
      if (lost) ship.loseFile();
      if (damaged) ship.damageFile(random);
      if (lost || damaged || any(plan.ship_restarts)) ship.start();
    }
    if (stormy && ship.on())
      for (const double at_s : plan.requests)
        if (passed(at_s)) ship.ask(now_ns, wishOf(plan, wishes));
    vehicle.offerAgain(now_ns, ground);
    vehicle.serve(now_ns, ground);
    water->advance(now_s);
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> frame;
    while (const std::size_t size = water->ship().receive(frame)) {
      if (ship.on()) ship.hear(now_ns, std::span(frame).first(size));
      if (listener && wishes() % 10 < 8) listener->hear(now_ns, std::span(frame).first(size));
    }
    if (ship.on() && plan.answers) ship.speak(now_ns, water->ship());
    while (const std::size_t size = water->vehicle().receive(frame))
      vehicle.hear(now_ns, std::span(frame).first(size));
    // What a log that lacks the last moment has.
    if (stormy && std::any_of(plan.vehicle_restarts.begin(), plan.vehicle_restarts.end(),
                              [&](double at_s) { return at_s > now_s && at_s <= now_s + 2 * plan.step_s; }))
      vehicle.save();
    vehicle.speak(now_ns, water->vehicle(), [&](auto link_frame) { witness.sent(link_frame); });
    if (++steps % kStepsBetweenLooks != 0) return;
    if (ship.on()) witness.look(ship.model().map().store());
    if (listener) witness.look(listener->model().map().store());
  };

  std::int64_t now_ns = kStart_ns;
  double next_change_s = 0;
  for (double t = 0; t < plan.storm_s; t += plan.step_s, now_ns += nanoseconds(plan.step_s)) {
    for (; next_change_s <= t; next_change_s += plan.change_every_s)
      vehicle.offer(now_ns, ground, ground.change(random));
    step(now_ns, true);
  }
  // What is still under way is lost.
  for (sim::ChannelConfig* way : {&plan.up, &plan.down})
    way->loss = way->mean_burst = way->duplicate = way->corrupt = way->reorder = 0;
  water = std::make_unique<sim::ChannelPair>(plan.up, plan.down, true);
  // Whatever was asked for is taken back.
  if (!plan.requests.empty()) {
    telemetry::Request request;
    request.kind = telemetry::Request::Kind::kResumeMap;
    ship.ask(now_ns, request);
    request.kind = telemetry::Request::Kind::kRate;
    request.rate_bps = std::max(80.0, plan.link.rate_bps);
    ship.ask(now_ns, request);
  }
  // Long enough for everything twice, and to listen for what was silent for long.
  const Slowness slow = slowness(plan);
  const double all_s = static_cast<double>(ground.size()) * (plan.requests.empty() ? 16 : 80) * 60 * 8 /
                       plan.link.rate_bps * slow.sending;
  // Where nobody asks, all comes once more, and what gives way to it.
  const bool coarse = plan.link.blocks.coarse_spacing > plan.link.blocks.spacing;
  const double least_s = plan.answers ? 0 : (coarse ? 3 : 2) * all_s + 400;
  // A ship that has lost frames needs turns enough to say of all of them whether it holds them.
  const bool lost = !plan.lost_files.empty() || !plan.damaged_files.empty();
  const double enough_s =
      (kQuiet_s + (lost ? static_cast<double>(vehicle.frames()) / 80 * 60 : 0)) * slow.turns;
  double quiet_s = 0;
  for (double t = 0;
       t < 3 * all_s + 3000 * slow.turns + enough_s && (plan.answers ? quiet_s < enough_s : t < least_s);
       t += plan.step_s, now_ns += nanoseconds(plan.step_s)) {
    step(now_ns, false);
    quiet_s = vehicle.drained() ? quiet_s + plan.step_s : 0;
  }

  witness.look(ship.model().map().store());
  const Differences d = compare(ground, ship.model().map().store(), plan.link.blocks, witness);
  result.nodes = d.nodes;
  result.frames = vehicle.frames();
  result.seconds = static_cast<double>(now_ns - kStart_ns) * 1e-9;
  const auto say = [&](std::size_t count, const char* what) {
    if (count > 0) result.wrong.push_back(formatted("%zu of %zu nodes %s", count, d.nodes, what));
  };
  say(d.stale, "stale");
  say(d.ghosts, "ghosts");
  say(d.missing, "missing");
  std::size_t disagreed = 0;
  vehicle.link().eachHeld(
      [&](const BlockKey& key, telemetry::Version first, telemetry::Version last, const MapBlock& held) {
        disagreed += agree(ship.model().map().store().find(key), first, last, held) ? 0 : 1;
      });
  if (disagreed > 0) result.wrong.push_back(formatted("of %zu blocks the ends disagree", disagreed));
  for (const auto& entry : ship.model().requests().entries()) {
    using State = monitor::RequestLedger::State;
    const bool forgotten = entry.state == State::kTaken && !plan.vehicle_restarts.empty();
    if (entry.state == State::kQueued || entry.state == State::kSent ||
        (entry.state == State::kTaken && !forgotten))
      result.wrong.push_back(monitor::describe(entry.request) + ": " + name(entry.state));
  }
  if (witness.wrong() > 0)
    result.wrong.push_back(formatted("%zu blocks shown that were never the vehicle's", witness.wrong()));
  if (witness.untrue() > 0)
    result.wrong.push_back(formatted("%zu nodes sent that the vehicle did not hold", witness.untrue()));
  if (plan.answers && quiet_s < enough_s) result.wrong.emplace_back("the link does not come to rest");
  return result;
}

}  // namespace fathom::test
