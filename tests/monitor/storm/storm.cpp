#include "tests/monitor/storm/storm.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <set>

#include "realtime/kernel/state_archive.hpp"
#include "realtime/kernel/text.hpp"
#include "sim/link/channel.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/monitor/model/monitor_model.hpp"
#include "telemetry/monitor/session_files.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"
#include "tests/monitor/storm/ground.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using telemetry::BlockKey;
using telemetry::MapBlock;

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kStart_ns = 1'790'000'000 * kSecond_ns;
constexpr telemetry::LinkIdentity kIdentity{7, 1234};
constexpr double kQuiet_s = 600;  // the ship has turns enough to say what it lacks

std::int64_t nanoseconds(double seconds) {
  return std::llround(seconds * 1e9);
}

// What was drawn.
struct Plan {
  telemetry::LinkSchedulerConfig link;
  sim::ChannelConfig up, down;
  int side = 3;
  double storm_s = 0, step_s = 0.2, change_every_s = 0;
  bool answers = true;
  double ship_from_s = 0;
  std::vector<double> vehicle_restarts, ship_restarts, lost_files, damaged_files;
  bool key = true;
  std::vector<std::pair<double, double>> ship_clock;  // from then on so far ahead of the vehicle's [s]
};

std::optional<telemetry::DownlinkKey> keyOf(const Plan& plan) {
  constexpr std::array<std::uint8_t, telemetry::DownlinkKey::kBytes> kSecret{1, 2, 3};
  return plan.key ? std::optional<telemetry::DownlinkKey>(kSecret) : std::nullopt;
}

Plan draw(std::mt19937& random) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto chance = [&](double share) { return between(0, 1) < share; };
  Plan p;
  constexpr std::array kFrames = {32, 64, 128, 256};
  p.link.identity = kIdentity;
  p.link.frame_bytes = kFrames[random() % kFrames.size()];
  p.link.rate_bps = std::exp(between(std::log(80.0), std::log(5400.0)));
  p.link.colour_bits = chance(0.5) ? 3 : 0;
  p.link.max_delay_s = 1;
  p.link.fast_rate_bps = 1e6;
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
  while (chance(0.4))
    p.ship_clock.emplace_back(between(0, 1) * p.storm_s, between(-1, 1) * std::pow(10, between(0, 8)));
  std::sort(p.ship_clock.begin(), p.ship_clock.end());
  return p;
}

std::string describe(const Plan& p) {
  return formatted(
      "%4.0f bit/s, %3d B, loss %.2f in %.1f, late %.2f by %3.0f s, doubled %.1f, damaged %.1f, %s, %2d x "
      "%2d "
      "squares in %3d, %4.0f s; restarts %zu + %zu, lost %zu, damaged %zu, ship from %4.0f s, %s, clock "
      "steps %zu",
      p.link.rate_bps, p.link.frame_bytes, p.up.loss, p.up.mean_burst, p.up.reorder, p.up.late_s,
      p.up.duplicate, p.up.corrupt, p.answers ? "answers" : "silence", p.side, p.side,
      p.link.blocks.max_squares, p.storm_s, p.vehicle_restarts.size(), p.ship_restarts.size(),
      p.lost_files.size(), p.damaged_files.size(), p.ship_from_s, p.key ? "key" : "no key",
      p.ship_clock.size());
}

class Vehicle {
 public:
  explicit Vehicle(const Plan& plan) : plan_(plan) { beginAnew(); }

  telemetry::LinkScheduler& link() { return *link_; }
  void offer(std::int64_t now_ns, const Ground& ground, std::size_t square) {
    since_saved_.push_back(square);
    link_->offer(ground.tile(square), now_ns);
  }
  void hear(std::int64_t now_ns, std::span<const std::uint8_t> frame) {
    const auto heard = ear_->accept(now_ns, frame, [&](const telemetry::Acknowledgement& a) {
      return link_->sentLately(a, now_ns, telemetry::DownlinkReceiver::kFresh_s);
    });
    if (heard.verdict != telemetry::DownlinkVerdict::kAccepted) return;
    link_->heard(now_ns);
    if (heard.content.acknowledgement) link_->acknowledge(*heard.content.acknowledgement, now_ns);
    if (heard.content.request) link_->request(*heard.content.request, now_ns);
  }
  void speak(std::int64_t now_ns, FramePort& modem) {
    telemetry::Status status;
    status.utc_ns = now_ns;
    link_->setStatus(status);
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> buffer;
    while (const std::size_t size = link_->nextFrame(now_ns, buffer)) {
      (void)modem.send(std::span(buffer).first(size));
      ++frames_;
    }
  }
  void save() {
    since_saved_.clear();
    state_.resize(std::size_t{64} << 20);
    rt::StateWriter writer(state_);
    link_->save(writer);
    ear_->save(writer);
    state_.resize(writer.size());
  }
  [[nodiscard]] bool restart(std::int64_t now_ns, const Ground& ground) {
    beginAnew();
    rt::StateReader reader(state_);
    const bool good = link_->load(reader) && ear_->load(reader);
    link_->noteRestart();
    for (const std::size_t square : since_saved_) link_->offer(ground.tile(square), now_ns);
    return good;
  }
  [[nodiscard]] std::uint64_t frames() const { return frames_; }
  // What gave way to newer ground comes again when there is room.
  void offerAgain(std::int64_t now_ns, const Ground& ground) {
    const auto next = [&](std::deque<std::size_t>& squares) {
      const std::size_t square = squares.front();
      squares.pop_front();
      offer(now_ns, ground, square);
    };
    while (!gave_way_.empty() && link_->hasRoom()) next(gave_way_);
    if (link_->spare() && !spare_.empty()) next(spare_);
  }
  [[nodiscard]] bool drained() const { return gave_way_.empty() && link_->drained(); }

 private:
  void beginAnew() {
    link_ = std::make_unique<telemetry::LinkScheduler>(plan_.link);
    link_->onGaveWay([this](const telemetry::BlockQueue::Whole& square, bool spare) {
      auto& squares = spare ? spare_ : gave_way_;
      const auto at = static_cast<std::size_t>(square.north * plan_.side + square.east);
      if (std::find(squares.begin(), squares.end(), at) == squares.end()) squares.push_back(at);
    });
    link_->setMissionInfo({"sirius", {}, kStart_ns, 0});
    ear_ = std::make_unique<telemetry::DownlinkReceiver>(kIdentity, keyOf(plan_), kStart_ns);
  }
  const Plan& plan_;
  std::unique_ptr<telemetry::LinkScheduler> link_;
  std::unique_ptr<telemetry::DownlinkReceiver> ear_;
  std::vector<std::size_t> since_saved_;      // offered
  std::deque<std::size_t> gave_way_, spare_;  // the first to be offered first
  std::vector<std::uint8_t> state_;
  std::uint64_t frames_ = 0;
};

class Ship {
 public:
  Ship(const Plan& plan, fs::path folder) : plan_(plan), folder_(std::move(folder)) {}

  [[nodiscard]] bool on() const { return model_ != nullptr; }
  [[nodiscard]] const monitor::MonitorModel& model() const { return *model_; }
  void start() {
    files_.reset();
    model_ = std::make_unique<monitor::MonitorModel>(kIdentity, keyOf(plan_));
    files_ = std::make_unique<monitor::SessionFiles>(folder_);
    std::string damage;
    files_->reload([this](auto bytes, auto utc_ns) { (void)model_->accept(bytes, utc_ns); },
                   [this] { model_->noteDamage(); }, damage);
  }
  void loseFile() { fs::remove_all(folder_); }
  void damageFile(std::mt19937& random) const {
    const fs::path path = folder_ / "received.bin";
    const auto size = static_cast<std::int64_t>(fs::exists(path) ? fs::file_size(path) : 0);
    if (size == 0) return;
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::int64_t>(random()) % size);
    for (int k = 0; k < 20; ++k) file.put(static_cast<char>(random()));
  }
  void hear(std::int64_t now_ns, std::span<const std::uint8_t> frame) {
    const std::int64_t own_ns = ownTime(now_ns);
    const auto decoded = model_->accept(frame, own_ns);
    files_->log(decoded, frame, own_ns, false);
  }
  void speak(std::int64_t now_ns, FramePort& modem) {
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> buffer;
    const std::size_t size = model_->speak(ownTime(now_ns), buffer, [this] { return files_->keep(); });
    if (size > 0) (void)modem.send(std::span(buffer).first(size));
  }

 private:
  [[nodiscard]] std::int64_t ownTime(std::int64_t now_ns) const {
    double ahead_s = 0;
    for (const auto& [from_s, by_s] : plan_.ship_clock)
      if (static_cast<double>(now_ns - kStart_ns) * 1e-9 >= from_s) ahead_s = by_s;
    return now_ns + nanoseconds(ahead_s);
  }
  const Plan& plan_;
  fs::path folder_;
  std::unique_ptr<monitor::MonitorModel> model_;
  std::unique_ptr<monitor::SessionFiles> files_;
};

// Counts of nodes that the ship shows otherwise than the vehicle holds them.
struct Differences {
  std::size_t nodes = 0, missing = 0, stale = 0, ghosts = 0;
};
Differences compare(const Ground& ground, const monitor::BlockStore& shown,
                    const telemetry::BlockQueueConfig& config) {
  // What is sent again only beyond update_error may be off by that and half a step of the wire's.
  const double bound = config.update_error + 0.001;
  Differences d;
  std::set<BlockKey> true_blocks;
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
    vehicle.offerAgain(now_ns, ground);
    water->advance(now_s);
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
    while (const std::size_t size = water->ship().receive(frame))
      if (ship.on()) ship.hear(now_ns, std::span(frame).first(size));
    if (ship.on() && plan.answers) ship.speak(now_ns, water->ship());
    while (const std::size_t size = water->vehicle().receive(frame))
      vehicle.hear(now_ns, std::span(frame).first(size));
    // What a log that lacks the last moment has.
    if (stormy && std::any_of(plan.vehicle_restarts.begin(), plan.vehicle_restarts.end(),
                              [&](double at_s) { return at_s > now_s && at_s <= now_s + 2 * plan.step_s; }))
      vehicle.save();
    vehicle.speak(now_ns, water->vehicle());
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
  // Long enough for everything twice, and to listen for what was silent for long.
  const double all_s = static_cast<double>(ground.size()) * 16 * 60 * 8 / plan.link.rate_bps;
  const double least_s = plan.answers ? 0 : 2 * all_s + 400;  // where nobody asks, all comes once more
  // A ship that has lost frames needs turns enough to say of all of them whether it holds them.
  const bool lost = !plan.lost_files.empty() || !plan.damaged_files.empty();
  const double enough_s = kQuiet_s + (lost ? static_cast<double>(vehicle.frames()) / 80 * 60 : 0);
  double quiet_s = 0;
  for (double t = 0; t < 2 * all_s + 3000 + enough_s && (plan.answers ? quiet_s < enough_s : t < least_s);
       t += plan.step_s, now_ns += nanoseconds(plan.step_s)) {
    step(now_ns, false);
    quiet_s = vehicle.drained() ? quiet_s + plan.step_s : 0;
  }

  const Differences d = compare(ground, ship.model().map().store(), plan.link.blocks);
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
  if (plan.answers && quiet_s < enough_s) result.wrong.emplace_back("the link does not come to rest");
  return result;
}

}  // namespace fathom::test
