// link_storm: dives of the acoustic link in storms, each judged by what the ship shows after the calm. Exit
// status 1 when one is wrong.
#include <atomic>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <optional>
#include <thread>

#include "realtime/base/command_line.hpp"
#include "realtime/base/text.hpp"
#include "telemetry/map/map_packet.hpp"
#include "tests/monitor/storm/ends.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {
namespace {

using telemetry::BlockKey, telemetry::MapBlock;

// What a storm was and what came of it.
struct StormResult {
  std::string what;                // the storm in a line
  std::vector<std::string> wrong;  // sentences; empty: good
  std::size_t nodes = 0;           // of the vehicle's map at the end
  std::uint64_t frames = 0;        // that the vehicle sent
  double seconds = 0;              // of the dive, storm and calm
};

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

telemetry::Request randomRequest(const Plan& plan, std::mt19937& random) {
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

// One dive's link, drawn by the seed: frame size, rate, loss, bursts, doubled, late and damaged frames, half
// duplex with lag; ground that appears, grows, moves, is emptied and evicted; restarts of vehicle and ship, a
// ship that comes late, loses its file or finds it damaged, clocks that step. Then a calm: every block that
// waits goes out. Holds the ship's map against the vehicle's.
class Storm {
 public:
  explicit Storm(unsigned seed) : random_(seed), plan_(draw(random_)), chance_(seed) {
    if (plan_.listener) {
      listener_ = std::make_unique<Ship>(plan_, folder_.path() / "listener");
      listener_->start();
    }
    result_.what = describe(plan_);
  }
  StormResult run() {
    double next_change_s = 0;
    for (double t = 0; t < plan_.storm_s; t += plan_.step_s, now_ns_ += nanoseconds(plan_.step_s)) {
      for (; next_change_s <= t; next_change_s += plan_.change_every_s)
        vehicle_.offer(now_ns_, ground_, ground_.change(random_));
      step(true);
    }
    calm();
    judge();
    return std::move(result_);
  }

 private:
  void restartAtTheirTimes(double before_s, double now_s) {
    const auto any = [&](const std::vector<double>& times) {
      return std::any_of(times.begin(), times.end(),
                         [&](double at_s) { return at_s > before_s && at_s <= now_s; });
    };
    if (any(plan_.vehicle_restarts) && !vehicle_.restart(now_ns_, ground_))
      result_.wrong.emplace_back("a state does not load");
    startShip(now_s);
    if (!ship_.on()) return;
    const bool lost = any(plan_.lost_files), damaged = any(plan_.damaged_files);
    if (lost) ship_.loseFile();
    if (damaged) ship_.damageFile(random_);
    if (lost || damaged || any(plan_.ship_restarts)) ship_.start();
    for (const double at_s : plan_.requests)
      if (any({at_s})) ship_.ask(now_ns_, randomRequest(plan_, chance_));
  }
  void startShip(double now_s) {
    if (!ship_.on() && now_s >= plan_.ship_from_s) ship_.start();
  }
  void step(bool stormy) {
    const double before_s = static_cast<double>(now_ns_ - kStart_ns) * 1e-9 - plan_.step_s,
                 now_s = before_s + plan_.step_s;
    if (stormy)
      restartAtTheirTimes(before_s, now_s);
    else
      startShip(now_s);
    vehicle_.offerAgain(now_ns_, ground_);
    vehicle_.serve(now_ns_, ground_);
    water_->advance(now_s);
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> frame;
    while (const std::size_t size = water_->ship().receive(frame)) {
      if (ship_.on()) ship_.receive(now_ns_, std::span(frame).first(size));
      if (listener_ && chance_() % 10 < 8) listener_->receive(now_ns_, std::span(frame).first(size));
    }
    if (ship_.on() && plan_.answers) ship_.speak(now_ns_, water_->ship());
    while (const std::size_t size = water_->vehicle().receive(frame))
      vehicle_.receive(now_ns_, std::span(frame).first(size));
    // The state in a log that lacks the last moment.
    if (stormy && std::any_of(plan_.vehicle_restarts.begin(), plan_.vehicle_restarts.end(),
                              [&](double at_s) { return at_s > now_s && at_s <= now_s + 2 * plan_.step_s; }))
      vehicle_.save();
    vehicle_.speak(now_ns_, water_->vehicle(), [&](auto link_frame) { witness_.sent(link_frame); });
    if (++steps_ % kStepsBetweenLooks != 0) return;
    if (ship_.on()) witness_.look(ship_.model().map().store());
    if (listener_) witness_.look(listener_->model().map().store());
  }
  // No losses, no restarts, no requests, until both ends are quiet.
  void calm() {
    // What is in transit is lost.
    for (sim::ChannelConfig* channel : {&plan_.up, &plan_.down})
      channel->loss = channel->mean_burst = channel->duplicate = channel->corrupt = channel->reorder = 0;
    water_ = std::make_unique<sim::ChannelPair>(plan_.up, plan_.down, true);
    // Pause and rate are taken back.
    if (!plan_.requests.empty()) {
      telemetry::Request request{.kind = telemetry::Request::Kind::kResumeMap};
      ship_.ask(now_ns_, request);
      request.kind = telemetry::Request::Kind::kRate;
      request.rate_bps = std::max(80.0, plan_.link.rate_bps);
      ship_.ask(now_ns_, request);
    }
    // Long enough for everything twice, and to listen for what was silent for long.
    const Slowness slow = slowness(plan_);
    const double all_s = static_cast<double>(ground_.size()) * (plan_.requests.empty() ? 16 : 80) * 60 * 8 /
                         plan_.link.rate_bps * slow.sending;
    // Where nobody asks, everything is sent once more, and what is evicted for it.
    const bool coarse = plan_.link.blocks.coarse_spacing > plan_.link.blocks.spacing;
    const double least_s = plan_.answers ? 0 : (coarse ? 3 : 2) * all_s + 400;
    // A ship that has lost frames needs turns enough to say of all of them whether it holds them.
    const bool lost = !plan_.lost_files.empty() || !plan_.damaged_files.empty();
    const double enough_s =
        (kQuiet_s + (lost ? static_cast<double>(vehicle_.frames()) / 80 * 60 : 0)) * slow.turns;
    double quiet_s = 0;
    for (double t = 0;
         t < 3 * all_s + 3000 * slow.turns + enough_s && (plan_.answers ? quiet_s < enough_s : t < least_s);
         t += plan_.step_s, now_ns_ += nanoseconds(plan_.step_s)) {
      step(false);
      quiet_s = vehicle_.drained() ? quiet_s + plan_.step_s : 0;
    }
    if (plan_.answers && quiet_s < enough_s) result_.wrong.emplace_back("the link does not come to rest");
  }
  void judge() {
    const monitor::BlockStore& shown = ship_.model().map().store();
    witness_.look(shown);
    const Differences d = compare(ground_, shown, plan_.link.blocks, witness_);
    result_.nodes = d.nodes;
    result_.frames = vehicle_.frames();
    result_.seconds = static_cast<double>(now_ns_ - kStart_ns) * 1e-9;
    const auto say = [&](std::size_t count, const char* what) {
      if (count > 0) result_.wrong.push_back(formatted("%zu of %zu nodes %s", count, d.nodes, what));
    };
    say(d.stale, "stale");
    say(d.ghosts, "ghosts");
    say(d.missing, "missing");
    std::size_t disagreed = 0;
    vehicle_.link().eachHeld(
        [&](const BlockKey& key, telemetry::Version first, telemetry::Version last, const MapBlock& held) {
          disagreed += agree(shown.find(key), first, last, held) ? 0 : 1;
        });
    if (disagreed > 0) result_.wrong.push_back(formatted("of %zu blocks the ends disagree", disagreed));
    for (const auto& entry : ship_.model().requests().entries()) {
      using State = monitor::RequestLedger::State;
      const bool forgotten = entry.state == State::kTaken && !plan_.vehicle_restarts.empty();
      if (entry.state == State::kQueued || entry.state == State::kSent ||
          (entry.state == State::kTaken && !forgotten))
        result_.wrong.push_back(monitor::describe(entry.request) + ": " + name(entry.state));
    }
    if (witness_.wrong() > 0)
      result_.wrong.push_back(formatted("%zu blocks shown that were never the vehicle's", witness_.wrong()));
    if (witness_.untrue() > 0)
      result_.wrong.push_back(formatted("%zu nodes sent that the vehicle did not hold", witness_.untrue()));
  }

  std::mt19937 random_;
  Plan plan_;
  std::mt19937 chance_;  // of requests, and of the listener's losses
  StormResult result_;
  const TemporaryFolder folder_;
  Vehicle vehicle_{plan_};
  Ship ship_{plan_, folder_.path() / "ship"};
  std::unique_ptr<sim::ChannelPair> water_ = std::make_unique<sim::ChannelPair>(plan_.up, plan_.down, true);
  Ground ground_{plan_.side};
  std::unique_ptr<Ship> listener_;
  Witness witness_{ground_};
  std::size_t steps_ = 0;
  std::int64_t now_ns_ = kStart_ns;
};

struct Options {
  int runs = 50, first = 1, jobs = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
};

int report(const Options& o) {
  std::atomic<int> next = 0;
  std::mutex printing;
  int bad = 0;
  std::uint64_t frames = 0;
  const auto work = [&] {
    for (int k = next++; k < o.runs; k = next++) {
      const StormResult r = Storm(static_cast<unsigned>(o.first + k)).run();
      const std::lock_guard lock(printing);
      frames += r.frames;
      bad += r.wrong.empty() ? 0 : 1;
      std::printf("%-4s %4d %s: %zu nodes, %llu frames in %.0f s\n", r.wrong.empty() ? "good" : "BAD",
                  o.first + k, r.what.c_str(), r.nodes, static_cast<unsigned long long>(r.frames), r.seconds);
      for (const std::string& what : r.wrong) std::printf("          %s\n", what.c_str());
      std::fflush(stdout);
    }
  };
  std::vector<std::thread> threads;
  for (int j = 0; j < o.jobs; ++j) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();
  std::printf("%d of %d storms good, %llu frames\n", o.runs - bad, o.runs,
              static_cast<unsigned long long>(frames));
  return bad == 0 ? 0 : 1;
}

void stormReport(CommandLine& program) {
  static Options o;
  CommandLine& command = program.command(
      "storm", "The ship's map against the vehicle's after storms of the link", "", [] { return report(o); });
  command.shown("--runs", o.runs, "how many", 1, 1e6);
  command.shown("--first", o.first, "seed of the first");
  command.shown("--jobs", o.jobs, "at once", 1, 256);
}

}  // namespace
}  // namespace fathom::test

int main(int argc, char** argv) {
  fathom::CommandLine app("Storms of the link");
  fathom::test::stormReport(app);
  return app.run("link_storm", argc, argv);
}
