#include "firmware_if/predive/predive_watch.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <thread>

#include "firmware_if/devices/sample_source.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr double kDark = 0.02, kSaturated = 0.99;
constexpr int kLineStep = 4;           // lines looked at: every fourth, some 600 of an image of 1.4 Mpx
constexpr double kOverNoise = 10;      // slopes of edges against that of noise
constexpr double kLeastSlope = 0.004;  // of full scale a pixel: a grey level of 8 bits
constexpr double kSharpest = 0.1;      // share of the edges that counts
constexpr std::size_t kMaxEdges = 200'000;

// Grey levels of full scale, one a pixel; a Bayer image one a block of 2 x 2.
struct Grey {
  int width = 0, height = 0;
  std::vector<float> at;
};

double sampleAt(const ImageView& image, int x, int y, int channel, int channels) {
  const auto* row = static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(y) * image.stride;
  const int i = x * channels + channel;
  if (image.bits == 8) return row[i] / 255.0;
  const double full = static_cast<double>((1 << image.bits) - 1);
  return std::min(1.0, reinterpret_cast<const std::uint16_t*>(row)[i] / full);
}

Grey readGrey(const ImageView& image, ImageQuality& quality) {
  const bool bayer = image.format == PixelFormat::kBayerRggb;
  const int channels = image.format == PixelFormat::kRgb ? 3 : 1, step = bayer ? 2 : 1;
  Grey grey;
  grey.width = image.width / step;
  grey.height = image.height / step;
  grey.at.resize(static_cast<std::size_t>(grey.width) * static_cast<std::size_t>(grey.height));
  double sum = 0, dark = 0, saturated = 0, count = 0;
  for (int y = 0; y < grey.height; ++y) {
    for (int x = 0; x < grey.width; ++x) {
      double mean = 0;
      for (int dy = 0; dy < step; ++dy)
        for (int dx = 0; dx < step; ++dx)
          for (int channel = 0; channel < channels; ++channel) {
            const double value = sampleAt(image, x * step + dx, y * step + dy, channel, channels);
            mean += value;
            dark += value < kDark ? 1 : 0;
            saturated += value >= kSaturated ? 1 : 0;
            ++count;
          }
      sum += mean;
      grey.at[static_cast<std::size_t>(y) * static_cast<std::size_t>(grey.width) +
              static_cast<std::size_t>(x)] = static_cast<float>(mean / (step * step * channels));
    }
  }
  if (count > 0) {
    quality.mean = sum / count;
    quality.dark_share = dark / count;
    quality.saturated_share = saturated / count;
  }
  return grey;
}

// Slope of the noise: the median of second differences, which edges and shading hardly touch.
double noiseSlope(const Grey& grey) {
  std::vector<float> second;
  for (int y = 0; y < grey.height; y += 2 * kLineStep) {
    const float* row = grey.at.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(grey.width);
    for (int x = 1; x + 1 < grey.width; x += 2)
      second.push_back(std::abs(row[x - 1] - 2 * row[x] + row[x + 1]));
  }
  if (second.empty()) return 0;
  const auto middle = second.begin() + static_cast<std::ptrdiff_t>(second.size() / 2);
  std::nth_element(second.begin(), middle, second.end());
  // |a - 2 b + c| of white noise has the median 0.6745 sqrt(6) sigma; a central difference sqrt(1/2) sigma.
  return *middle / (0.6745 * std::sqrt(6.0)) * std::sqrt(0.5);
}

// Widths of the edges along one line of `count` levels, `stride` apart.
void addEdges(const float* line, int count, std::size_t stride, double least_slope,
              std::vector<double>& widths) {
  const auto level = [&](int i) { return static_cast<double>(line[static_cast<std::size_t>(i) * stride]); };
  const auto slope = [&](int i) { return (level(i + 1) - level(i - 1)) / 2; };
  for (int i = 2; i + 2 < count; ++i) {
    const double here = slope(i), size = std::abs(here);
    if (size < least_slope || size < std::abs(slope(i - 1)) || size <= std::abs(slope(i + 1))) continue;
    const double sign = here > 0 ? 1 : -1;
    int from = i, to = i;
    while (from > 0 && sign * (level(from) - level(from - 1)) > 0) --from;
    while (to + 1 < count && sign * (level(to + 1) - level(to)) > 0) ++to;
    if (widths.size() < kMaxEdges) widths.push_back(sign * (level(to) - level(from)) / size);
    i = std::max(i, to - 1);
  }
}

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

ImageQuality measureImage(const ImageView& image) {
  ImageQuality quality;
  if (image.empty()) return quality;
  const Grey grey = readGrey(image, quality);
  const double least_slope = std::max(kLeastSlope, kOverNoise * noiseSlope(grey));
  std::vector<double> widths;
  const auto width = static_cast<std::size_t>(grey.width);
  for (int y = 0; y < grey.height; y += kLineStep)
    addEdges(grey.at.data() + static_cast<std::size_t>(y) * width, grey.width, 1, least_slope, widths);
  for (int x = 0; x < grey.width; x += kLineStep)
    addEdges(grey.at.data() + x, grey.height, width, least_slope, widths);
  quality.edges = static_cast<int>(widths.size());
  if (quality.edges < ImageQuality::kFewestEdges) return quality;
  const auto sharpest =
      widths.begin() + static_cast<std::ptrdiff_t>(kSharpest * static_cast<double>(widths.size()));
  std::nth_element(widths.begin(), sharpest, widths.end());
  quality.edge_width_px = *sharpest * (image.format == PixelFormat::kBayerRggb ? 2 : 1);
  return quality;
}

PrediveFacts watchDevices(PrediveDevices& devices, const std::function<bool()>& more,
                          const VehicleTime& now) {
  PrediveFacts facts;
  facts.expected = devices.expected;
  const auto begin = std::chrono::steady_clock::now();

  std::vector<NoteSamples> notes(devices.sources.size());
  std::vector<PollGuard> guards(devices.sources.size());
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < devices.sources.size(); ++i) {
    threads.emplace_back([&, i] {
      while (more()) guards[i].poll(*devices.sources[i], kPollMs, notes[i], rt::RealClock().monotonicNs());
    });
  }
  for (std::size_t side = 0; side < devices.cameras.size(); ++side) {
    PrediveDevices::Camera& camera = devices.cameras[side];
    CameraFacts& gives = facts.cameras[side];
    gives.used = camera.source != nullptr;
    if (!gives.used) continue;
    threads.emplace_back([&] {
      NoteFrames sink(*camera.source, gives);
      PollGuard guard;
      while (more()) guard.poll(*camera.source, kPollMs, sink, rt::RealClock().monotonicNs());
      try {
        if (camera.identity) gives.identity = camera.identity();
      } catch (const std::exception& e) {
        gives.identity.failure = e.what();
      }
      gives.health = camera.source->health();
      guard.markFailure(gives.health);
      if (!guard.reason().empty()) gives.identity.failure = guard.reason();
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
    guards[i].markFailure(facts.sources.back());
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
