// Measures the acoustic link: frames sent until a set of tiles is complete, over the loss of frames.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <set>
#include <vector>

#include "realtime/base/input_error.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/ship/link_receiver.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/reports.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::bench {
namespace {

// A set of tiles through the real scheduler and receiver over a channel that only loses frames, seed by seed.
struct ReliabilityConfig {
  double loss = 0.3;
  double mean_burst = 0;  // 0: each frame by itself
  bool feedback = true;   // acknowledgements every 32 frames, or when the sender has nothing else to send
  int seeds = 200;
};

struct ReliabilityResult {
  int packets = 0;            // K: frames without loss
  double bound = 0;           // K / (1 - p)
  double mean_frames = 0;     // map and repair frames sent until the receiver has 99 % of the blocks
  double standard_error = 0;  // of the mean
  double p95_frames = 0;
  double finished_share = 0;  // runs that reached 99 %; the others count with all frames sent
  double mean_complete = 0;   // share of blocks when the sender stopped
};

constexpr int kFrameBytes = 32;
constexpr double kRate = 1000;  // [bit/s]
constexpr int kAcknowledgeEvery = 32;
constexpr double kComplete = 0.99;
constexpr std::int64_t kStart_ns = 1'790'000'000'000'000'000;
constexpr std::int64_t kStep_ns = 100'000'000;
constexpr int kIdleSteps = 200;  // nothing for so long: the sender has stopped

// Gilbert-Elliott, as in the simulated channel: every frame of the bad state is lost.
class Losses {
 public:
  Losses(double loss, double mean_burst, std::uint64_t seed)
      : loss_(loss), burst_(mean_burst), random_(seed) {
    bad_ = uniform_(random_) < loss;
  }
  bool next() {
    if (burst_ <= 1) return uniform_(random_) < loss_;
    const double leave = 1 / burst_, enter = leave * loss_ / (1 - loss_);
    bad_ = uniform_(random_) < (bad_ ? 1 - leave : enter);
    return bad_;
  }

 private:
  double loss_, burst_;
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> uniform_{0, 1};
  bool bad_;
};

struct Run {
  int frames = 0;
  bool finished = false;
  double complete = 0;
};

Run runOnce(int tiles, double loss, double mean_burst, bool feedback, std::uint64_t seed) {
  telemetry::LinkSchedulerConfig config;
  config.rate_bps = kRate;
  config.frame_bytes = kFrameBytes;
  config.loss_rate = loss;
  config.mean_burst = mean_burst;
  config.half_duplex = feedback;
  config.max_delay_s = 0;
  config.listen_s = 0.05;
  config.listen_every_s = kAcknowledgeEvery * kFrameBytes * 8 / kRate;
  config.listen_every_frames = kAcknowledgeEvery;
  config.colour_bits = 0;
  config.blocks.coarse_spacing = config.blocks.spacing;
  telemetry::LinkScheduler scheduler(config);
  for (int n = 0; n < tiles; ++n) scheduler.offer(telemetry::sampleTile(n % 8, n / 8), kStart_ns);
  const auto all = static_cast<std::size_t>(scheduler.counters().blocks_waiting);
  telemetry::LinkReceiver receiver;
  telemetry::MapPacketDecoder decoder;
  telemetry::DecodedMapPacket packet;
  std::set<telemetry::BlockKey> here;
  const auto deliver = [&](const telemetry::LinkReceiver::Message& message) {
    if (message.type != telemetry::MessageType::kMapPacket) return true;
    if (!decoder.decode(message.payload, packet)) return false;
    for (const telemetry::MapBlock& b : packet.blocks) here.insert(b.key);
    return true;
  };
  Losses losses(loss, mean_burst, seed);
  // A received frame: the vehicle knows that the ship listens.
  if (feedback) scheduler.received(kStart_ns);
  Run run;
  std::array<std::uint8_t, telemetry::kMaxFrameBytes> buffer;
  std::int64_t now = kStart_ns;
  for (int idle = 0; idle < kIdleSteps; ++idle, now += kStep_ns) {
    while (const std::size_t size = scheduler.nextFrame(now, buffer)) {
      idle = 0;
      ++run.frames;
      const auto frame = std::span<const std::uint8_t>(buffer).first(size);
      const bool turn = telemetry::decodeFrame(frame).header.turn;
      if (!losses.next()) receiver.accept(frame, deliver);
      if (static_cast<double>(here.size()) >= kComplete * static_cast<double>(all)) {
        run.finished = true;
        run.complete = 1;
        return run;
      }
      if (turn) scheduler.acknowledge(receiver.acknowledgement(), now);
    }
  }
  run.complete = static_cast<double>(here.size()) / static_cast<double>(all);
  return run;
}

ReliabilityResult measureReliability(const ReliabilityConfig& config) {
  // As many tiles as make 64 frames.
  constexpr int kPackets = 64;
  static const int tiles = [] {
    constexpr int kGuess = 8;
    int n = std::max(1, kGuess * kPackets / runOnce(kGuess, 0, 0, true, 1).frames - 1);
    while (runOnce(n, 0, 0, true, 1).frames < kPackets) ++n;
    return n;
  }();
  ReliabilityResult result;
  // Without acknowledgements, packets are smaller by the bytes for repair.
  result.packets = runOnce(tiles, 0, 0, config.feedback, 1).frames;
  result.bound = result.packets / (1 - config.loss);
  std::vector<double> frames;
  double sum = 0, squares = 0;
  for (int k = 0; k < config.seeds; ++k) {
    const Run run =
        runOnce(tiles, config.loss, config.mean_burst, config.feedback, 1000 + static_cast<std::uint64_t>(k));
    frames.push_back(run.frames);
    sum += run.frames;
    squares += static_cast<double>(run.frames) * run.frames;
    result.finished_share += run.finished ? 1.0 / config.seeds : 0;
    result.mean_complete += run.complete / config.seeds;
  }
  const double n = config.seeds;
  result.mean_frames = sum / n;
  result.standard_error = std::sqrt(std::max(0.0, squares / n - sum / n * (sum / n)) / n);
  std::sort(frames.begin(), frames.end());
  result.p95_frames = frames[static_cast<std::size_t>(0.95 * (n - 1))];
  return result;
}

Table reliability(int seeds) {
  Table table{"Frames until 99 % of the blocks are there",
              {{"acknowledged", 0},
               {"mean burst", 0},
               {"loss", 1},
               {"packets", 0},
               {"bound", 3},
               {"mean frames", 3},
               {"standard error", 3},
               {"ratio", 3},
               {"p95 ratio", 3},
               {"finished", 3},
               {"complete", 3}},
              {}};
  for (const bool feedback : {true, false})
    for (const double burst : {0.0, 5.0})
      for (const double loss : {0.1, 0.3, 0.5}) {
        const ReliabilityResult r = measureReliability({loss, burst, feedback, seeds});
        table.rows.push_back({feedback ? "yes" : "no", burst, loss, cell(r.packets), r.bound, r.mean_frames,
                              r.standard_error, r.mean_frames / r.bound, r.p95_frames / r.bound,
                              r.finished_share, r.mean_complete});
      }
  return table;
}

}  // namespace

void linkReport(CommandLine& program) {
  static int seeds = 200;
  static bool json = false;
  CommandLine& command = program.command(
      "link", "Frames over the acoustic link until a set of tiles is complete, by loss", "", [] {
        Page page("The link");
        page.add(reliability(seeds));
        std::printf("%s", json ? page.json().c_str() : page.text().c_str());
        return kExitSuccess;
      });
  command.shown("--seeds", seeds, "runs of each loss", 1, 100000);
  command.add_flag("--json", json, "the table as JSON");
}

}  // namespace fathom::bench
