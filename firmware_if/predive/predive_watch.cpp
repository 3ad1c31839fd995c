#include "firmware_if/predive/predive_watch.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <thread>

#include "firmware_if/devices/poll_fence.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr int kPollMs = 50;
constexpr std::chrono::seconds kGreetEvery{
    5};                                   // the travel times of greeting and answer, and the answer's length
constexpr std::size_t kMaxFrames = 2000;  // of one camera: minutes, even at its fastest

using SampleTable = std::array<SampleFacts, kDeviceKinds>;

class NoteSamples final : public SampleSink {
 public:
  void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept override {
    SampleFacts& facts = table[sample.index()];
    if (facts.count == 0) facts.first_ns = arrival_utc_ns;
    if (facts.count > 0)
      facts.longest_gap_s =
          std::max(facts.longest_gap_s, static_cast<double>(arrival_utc_ns - facts.last_ns) / 1e9);
    ++facts.count;
    facts.last_ns = arrival_utc_ns;
    facts.last = sample;
    const auto* dvl = std::get_if<DvlSample>(&sample);
    if (dvl == nullptr || dvl->velocity) ++facts.usable;
  }
  void raw(std::int64_t, std::string_view, std::span<const std::uint8_t>) noexcept override {}
  SampleTable table;
};

class NoteFrames final : public FrameSink {
 public:
  NoteFrames(CameraSource& camera, CameraFacts& facts) : camera_(camera), facts_(facts) {
    facts_.frames.reserve(kMaxFrames);
  }
  void frame(const CameraFrame& frame) noexcept override {
    const ImageView image = camera_.view(frame);
    if (facts_.frames.size() < kMaxFrames)
      facts_.frames.push_back(
          {frame.frame_id, frame.utc_ns, frame.device_ns, image.width, image.height, measureImage(image)});
    camera_.pool().release(frame.block);
  }

 private:
  CameraSource& camera_;
  CameraFacts& facts_;
};

// One device's samples beside another's: a kind that two devices give counts for the one that gives more.
void merge(const SampleTable& from, SampleTable& into) {
  for (std::size_t kind = 0; kind < from.size(); ++kind)
    if (from[kind].count > into[kind].count) into[kind] = from[kind];
}

}  // namespace

PrediveFacts watchDevices(PrediveDevices& devices, const std::function<bool()>& more,
                          const VehicleTime& now) {
  PrediveFacts facts;
  facts.expected = devices.expected;
  const auto begin = std::chrono::steady_clock::now();

  std::vector<NoteSamples> notes(devices.sources.size());
  std::vector<PollFence> fences(devices.sources.size());
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < devices.sources.size(); ++i) {
    threads.emplace_back([&, i] {
      while (more()) fences[i].poll(*devices.sources[i], kPollMs, notes[i], rt::RealClock().monotonicNs());
    });
  }
  for (std::size_t side = 0; side < devices.cameras.size(); ++side) {
    PrediveDevices::Camera& camera = devices.cameras[side];
    CameraFacts& gives = facts.cameras[side];
    gives.used = camera.source != nullptr;
    if (!gives.used) continue;
    threads.emplace_back([&] {
      NoteFrames sink(*camera.source, gives);
      PollFence fence;
      while (more()) fence.poll(*camera.source, kPollMs, sink, rt::RealClock().monotonicNs());
      try {
        if (camera.identity) gives.identity = camera.identity();
      } catch (const std::exception& e) {
        gives.identity.failure = e.what();
      }
      gives.health = camera.source->health();
      fence.markFailure(gives.health);
      if (!fence.reason().empty()) gives.identity.failure = fence.reason();
    });
  }
  facts.modem.used = devices.modem_used;
  facts.modem.open = devices.modem != nullptr;
  facts.modem.failure = devices.modem_failure;
  if (devices.modem != nullptr) {
    threads.emplace_back([&] {
      std::array<std::uint8_t, FramePort::kMaxFrameBytes> frame;
      auto next_greeting = std::chrono::steady_clock::now();
      while (more()) {
        if (devices.link.greet && std::chrono::steady_clock::now() >= next_greeting) {
          next_greeting += kGreetEvery;
          static_cast<void>(devices.modem->send({frame.data(), devices.link.greet(now(), frame)}));
        }
        const std::size_t size = devices.modem->receive(frame);
        if (size == 0) {
          std::this_thread::sleep_for(std::chrono::milliseconds(kPollMs));
          continue;
        }
        ++facts.modem.frames;
        if (!devices.link.read) continue;
        const PrediveLink::Received received = devices.link.read({frame.data(), size});
        facts.modem.ours += received.ours ? 1 : 0;
        if (received.fix) facts.modem.fix = received.fix;
      }
      facts.modem.broken = devices.modem->droppedFrames();
    });
  }
  for (std::thread& thread : threads) thread.join();
  facts.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  for (std::size_t i = 0; i < devices.sources.size(); ++i) {
    facts.sources.push_back(devices.sources[i]->health());
    fences[i].markFailure(facts.sources.back());
    merge(notes[i].table, facts.samples);
  }
  // A fix that came over LCM and one of the ship's frame are the same to the vehicle.
  SampleFacts& fixes = facts.samples[SensorSample(UsblFix{}).index()];
  if (fixes.count == 0 && facts.modem.fix) {
    fixes.count = fixes.usable = 1;
    fixes.first_ns = fixes.last_ns = now();
    fixes.last = *facts.modem.fix;
  }
  return facts;
}

}  // namespace fathom::io
