#pragma once

#include <algorithm>

#include "realtime/base/bytes/state_archive.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/monitor/model/monitor_model.hpp"
#include "telemetry/monitor/session.hpp"
#include "telemetry/wire/frame.hpp"
#include "tests/monitor/storm/plan.hpp"

namespace fathom::test {

namespace fs = std::filesystem;

// The vehicle's end of the link, as the onboard program uses it.
class Vehicle {
 public:
  explicit Vehicle(const Plan& plan) : plan_(plan) { start(); }

  telemetry::LinkScheduler& link() { return *link_; }
  void offer(std::int64_t now_ns, const Ground& ground, std::size_t square) {
    since_saved_.push_back(square);
    now_ns = ownTime(now_ns);
    link_->offer(ground.tile(square), now_ns);
    if (coarse()) link_->offer(ground.coarse(square), now_ns);
    for (const auto& [quarter, max_error] : detailed_)
      if (quarter / 4 == square)
        link_->offer(ground.detail(square, static_cast<int>(quarter % 4)), now_ns, max_error);
  }
  // What the program does with a request for detail: every quarter of a square that the rectangle touches.
  void serve(std::int64_t now_ns, const Ground& ground) {
    const auto* detail = link_->detail();
    if (detail == nullptr) return;
    for (std::size_t square = 0; square < ground.size(); ++square)
      for (int q = 0; q < 4; ++q) {
        const HeightTile tile = ground.detail(square, q);
        if (tile.north0() > detail->north_max || tile.north0() + tile.size < detail->north_min ||
            tile.east0() > detail->east_max || tile.east0() + tile.size < detail->east_min)
          continue;
        const auto [known, is_new] =
            detailed_.try_emplace(4 * square + static_cast<std::size_t>(q), detail->max_error);
        known->second = std::min(known->second, detail->max_error);
        link_->offer(tile, ownTime(now_ns), detail->max_error);
      }
    link_->detailServed();
  }
  void receive(std::int64_t now_ns, std::span<const std::uint8_t> modem_frame) {
    telemetry::LinkFrames frames(modem_frame);
    while (const auto frame = frames.next()) obey(now_ns, *frame);
  }
  void obey(std::int64_t true_ns, std::span<const std::uint8_t> frame) {
    const std::int64_t now_ns = ownTime(true_ns);
    const auto result = receiver_->accept(now_ns, frame, [&](const telemetry::Acknowledgement& a) {
      return link_->sentLately(a, now_ns, telemetry::DownlinkReceiver::kFresh_s);
    });
    if (result.verdict != telemetry::DownlinkVerdict::kAccepted) return;
    link_->received(now_ns);
    if (result.content.acknowledgement) link_->acknowledge(*result.content.acknowledgement, now_ns);
    if (result.content.request) link_->request(*result.content.request, now_ns, result.counter);
  }
  // `on_sent`, for every link frame.
  void speak(std::int64_t true_ns, FramePort& modem,
             const std::function<void(std::span<const std::uint8_t>)>& on_sent) {
    const std::int64_t now_ns = ownTime(true_ns);
    link_->setStatus(telemetry::Status{.utc_ns = now_ns});
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
    while (const std::size_t size = link_->nextFrame(now_ns, buffer)) {
      (void)modem.send(std::span(buffer).first(size));
      telemetry::LinkFrames frames(std::span<const std::uint8_t>(buffer).first(size));
      while (const auto frame = frames.next()) on_sent(*frame);
    }
  }
  void save() {
    since_saved_.clear();
    state_.resize(std::size_t{64} << 20);
    rt::StateWriter writer(state_);
    link_->save(writer);
    receiver_->save(writer);
    state_.resize(writer.size());
  }
  [[nodiscard]] bool restart(std::int64_t now_ns, const Ground& ground) {
    start();
    rt::StateReader reader(state_);
    const bool good = link_->load(reader) && receiver_->load(reader);
    link_->noteRestart();
    const std::vector<std::size_t> lately = since_saved_;
    for (const std::size_t square : lately) offer(now_ns, ground, square);
    return good;
  }
  // Link frames.
  [[nodiscard]] std::uint64_t frames() const { return link_->counters().frames; }
  // Offers again what was evicted for newer ground, when there is room.
  void offerAgain(std::int64_t now_ns, const Ground& ground) {
    const auto next = [&](std::deque<telemetry::BlockQueue::Whole>& squares) {
      const telemetry::BlockQueue::Whole square = squares.front();
      squares.pop_front();
      offerOne(ownTime(now_ns), ground, square);
    };
    while (!evicted_.empty() && link_->hasRoom()) next(evicted_);
    while (link_->spare() && !spare_.empty() && evicted_.empty()) next(spare_);
  }
  [[nodiscard]] bool drained() const { return evicted_.empty() && link_->drained(); }

 private:
  [[nodiscard]] bool coarse() const { return plan_.link.blocks.coarse_spacing > plan_.link.blocks.spacing; }
  [[nodiscard]] std::int64_t ownTime(std::int64_t now_ns) const {
    return now_ns + aheadAt(plan_.vehicle_clock, now_ns);
  }
  void start() {
    link_ = std::make_unique<telemetry::LinkScheduler>(plan_.link);
    link_->onEvicted([this](const telemetry::BlockQueue::Whole& square, bool spare) {
      auto& squares = spare ? spare_ : evicted_;
      const auto same = [&](const telemetry::BlockQueue::Whole& other) {
        return other.spacing == square.spacing && other.north == square.north && other.east == square.east;
      };
      if (std::none_of(squares.begin(), squares.end(), same)) squares.push_back(square);
    });
    link_->setMissionInfo({"sirius", {}, kStart_ns, 0});
    receiver_ = std::make_unique<telemetry::DownlinkReceiver>(kIdentity, keyOf(plan_), kStart_ns);
  }
  // A square of any of the link's lattices as the ground is there.
  void offerOne(std::int64_t now_ns, const Ground& ground, const telemetry::BlockQueue::Whole& place) {
    const double side = telemetry::spacingOf(place.spacing) * HeightTile::kCells;
    const std::size_t square = *ground.squareAt(place.north * side, place.east * side);
    if (side > Ground::kSquare_m) return link_->offer(ground.coarse(square), now_ns);
    if (side == Ground::kSquare_m) return link_->offer(ground.tile(square), now_ns);
    const auto quarter = static_cast<std::size_t>((place.north & 1) * 2 + (place.east & 1));
    if (const auto detail = detailed_.find(4 * square + quarter); detail != detailed_.end())
      link_->offer(ground.detail(square, static_cast<int>(quarter)), now_ns, detail->second);
  }
  const Plan& plan_;
  std::unique_ptr<telemetry::LinkScheduler> link_;
  std::unique_ptr<telemetry::DownlinkReceiver> receiver_;
  std::vector<std::size_t> since_saved_;                      // offered
  std::deque<telemetry::BlockQueue::Whole> evicted_, spare_;  // the first to be offered first
  std::map<std::size_t, double> detailed_;  // quarters of squares, with the error asked for [m]
  std::vector<std::uint8_t> state_;
};

// The ship's end, as the monitor uses it.
class Ship {
 public:
  Ship(const Plan& plan, fs::path folder) : plan_(plan), folder_(std::move(folder)) {}

  [[nodiscard]] bool on() const { return model_ != nullptr; }
  [[nodiscard]] const monitor::MonitorModel& model() const { return *model_; }
  void start() {
    files_.reset();
    waiting_.clear();
    model_ = std::make_unique<monitor::MonitorModel>(kIdentity, keyOf(plan_));
    files_ = std::make_unique<monitor::SessionFiles>(folder_);
    std::string damage;
    files_->reload([this](auto bytes, auto utc_ns) { return model_->accept(bytes, utc_ns).verdict; },
                   [this] { model_->noteDamage(); }, damage);
  }
  // Somebody on the ship asks for something.
  void ask(std::int64_t now_ns, const telemetry::Request& request) {
    (void)model_->ask(request, ownTime(now_ns));
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
  void receive(std::int64_t now_ns, std::span<const std::uint8_t> frame) {
    const std::int64_t own_ns = ownTime(now_ns);
    if (!diskIsFull(now_ns)) keepWaiting();
    model_->receive(frame, own_ns, [&](const auto& decoded, std::span<const std::uint8_t> link_frame) {
      if (decoded.verdict != telemetry::FrameVerdict::kAccepted) return;
      waiting_.push_back({own_ns, {link_frame.begin(), link_frame.end()}, decoded});
    });
    if (!diskIsFull(now_ns)) keepWaiting();
  }
  void speak(std::int64_t now_ns, FramePort& modem) {
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
    const std::size_t size =
        model_->speak(ownTime(now_ns), buffer, [&] { return !diskIsFull(now_ns) && files_->keep(); });
    if (size > 0) (void)modem.send(std::span(buffer).first(size));
  }

 private:
  struct Waiting {
    std::int64_t utc_ns = 0;
    std::vector<std::uint8_t> bytes;
    telemetry::DecodedFrame decoded;
  };
  void keepWaiting() {
    for (const Waiting& w : waiting_) files_->log(w.decoded, w.bytes, w.utc_ns, false);
    waiting_.clear();
  }
  // What comes meanwhile is lost when the ship restarts.
  [[nodiscard]] bool diskIsFull(std::int64_t now_ns) const {
    const double t = static_cast<double>(now_ns - kStart_ns) * 1e-9;
    return std::any_of(plan_.full_disk.begin(), plan_.full_disk.end(),
                       [t](const auto& full) { return t >= full.first && t < full.second; });
  }
  [[nodiscard]] std::int64_t ownTime(std::int64_t now_ns) const {
    return now_ns + aheadAt(plan_.ship_clock, now_ns);
  }
  const Plan& plan_;
  fs::path folder_;
  std::unique_ptr<monitor::MonitorModel> model_;
  std::unique_ptr<monitor::SessionFiles> files_;
  std::vector<Waiting> waiting_;  // for room on the disk
};

}  // namespace fathom::test
