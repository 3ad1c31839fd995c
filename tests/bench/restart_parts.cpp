#include "tests/bench/restart_parts.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <span>
#include <vector>

#include "realtime/kernel/state_archive.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "realtime/onboard/onboard_config.hpp"
#include "recon/slam/navigation_graph.hpp"

namespace fathom::bench {
namespace {

using namespace fathom::onboard;
using Clock = std::chrono::steady_clock;

constexpr double kMega = 1 << 20;

double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// Takes all that is written and keeps nothing.
class NoSlots : public SlotStore {
 public:
  explicit NoSlots(std::size_t slots) : slots_(slots) {}
  [[nodiscard]] std::size_t slots() const override { return slots_; }
  [[nodiscard]] std::size_t slotBytes() const override { return std::size_t{1} << 20; }
  [[nodiscard]] bool write(std::size_t, std::span<const std::uint8_t>) override { return true; }
  [[nodiscard]] bool read(std::size_t, std::span<std::uint8_t>) override { return false; }

 private:
  std::size_t slots_;
};

// The k-th place of a survey of lines 100 m long.
SE3 placeOf(int k, double step, double spacing) {
  const int per_line = static_cast<int>(100 / step), line = k / per_line, along = k % per_line;
  const bool back = line % 2 == 1;
  const double north = (back ? per_line - 1 - along : along) * step;
  return SE3::fromEuler(0, 0, back ? M_PI : 0, {north, line * spacing, 20});
}

Mesh patch() {
  constexpr int kSide = 24;
  Mesh mesh;
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j) {
      const float x = 0.06F * static_cast<float>(i - kSide / 2),
                  y = 0.05F * static_cast<float>(j - kSide / 2);
      mesh.vertices.emplace_back(x, y, 2 + 0.1F * std::sin(4 * x) * std::cos(3 * y));
      mesh.sigma.push_back(0.01F);
      mesh.colours.push_back({100, 90, 80});
    }
  for (int i = 0; i + 1 < kSide; ++i)
    for (int j = 0; j + 1 < kSide; ++j) {
      const auto a = static_cast<std::uint32_t>(i * kSide + j), b = a + static_cast<std::uint32_t>(kSide);
      mesh.triangles.push_back({a, b, a + 1});
      mesh.triangles.push_back({b, b + 1, a + 1});
    }
  return mesh;
}

// Saves five times and loads once; prints a row.
template <typename T, typename Load>
bool report(const char* name, const T& full, std::span<std::uint8_t> buffer, const Load& load) {
  double least = 1e9, most = 0;
  std::size_t bytes = 0;
  for (int k = 0; k < 5; ++k) {
    const auto start = Clock::now();
    rt::StateWriter writer(buffer);
    full.save(writer);
    const double ms = millisecondsSince(start);
    least = std::min(least, ms);
    most = std::max(most, ms);
    bytes = writer.full() ? 0 : writer.size();
  }
  rt::StateReader reader(buffer.first(bytes));
  const auto start = Clock::now();
  const bool good = load(reader);
  std::printf("%-34s %9.1f %9.1f %9.1f %9.1f  %s\n", name, static_cast<double>(bytes) / kMega, least, most,
              millisecondsSince(start), good ? "" : reader.failure());
  std::fflush(stdout);
  return good;
}

}  // namespace

int reportRestartParts() {
  const OnboardConfig config = readOnboardConfig(std::nullopt);
  std::vector<std::uint8_t> buffer(std::size_t{512} << 20, 1);
  std::printf("%-34s %9s %9s %9s %9s\n", "part", "MiB", "save ms", "worst ms", "load ms");
  bool good = true;
  {
    NoSlots slots(static_cast<std::size_t>(config.max_pairs));
    const auto points = static_cast<std::size_t>(config.stereo.max_features);
    MovingMap map(config.map, &slots, points);
    const Mesh mesh = patch();
    for (int k = 0; k < config.max_pairs; ++k) {
      Mesh seen = mesh;
      const SE3 place = placeOf(k, 0.5, 1.2);
      (void)map.add(seen, k / 2, place, place);
    }
    const fusion::QuadtreeMap::Counters c = map.map().counters();
    std::printf("map: %d tiles, %d of %d layers, %llu groups coarsened\n", c.tiles_used, c.layers_used,
                c.layers, static_cast<unsigned long long>(c.coarsened));
    MovingMap loaded(config.map, &slots, points);
    good = report("map with 36,000 meshes", map, buffer,
                  [&](rt::StateReader& reader) { return loaded.load(reader, [](int) { return true; }); }) &&
           good;
    good = good && loaded.map().canonicalBytes() == map.map().canonicalBytes();
  }
  {
    slam::NavigationConfig graph_config = config.localisation.graph;
    graph_config.max_keyframes = config.localisation.max_keyframes;
    auto graph = std::make_unique<slam::NavigationGraph>(graph_config);
    constexpr double kStep = 0.8, kSpacing = 1.2, kSigma = 0.02;
    constexpr int kPerLine = 125, kClosureEvery = 10, kStepEvery = 25;
    const Matrix6d covariance = kSigma * kSigma * Matrix6d::Identity();
    for (int k = 0; k < graph_config.max_keyframes; ++k) {
      slam::KeyframeInput input;
      input.utc_ns = std::int64_t{k} * 900'000'000;
      input.T_odom_cam = placeOf(k, kStep, kSpacing);
      const auto between = [&](int a, int b) {
        return placeOf(a, kStep, kSpacing).inverse() * placeOf(b, kStep, kSpacing);
      };
      if (!graph->addKeyframe(input)) break;
      if (k > 0) (void)graph->addLink(slam::LinkKind::kOdometry, k - 1, k, between(k - 1, k), covariance);
      const int beside = k - 2 * (k % kPerLine) - 1;  // on the line before
      if (k % kClosureEvery == 0 && beside >= 0 && beside + kStepEvery < k)
        (void)graph->addLink(slam::LinkKind::kClosure, beside, k, between(beside, k), covariance);
      if (k % kStepEvery == 0) (void)graph->step();
    }
    std::printf("graph: %d keyframes, %d poses, %d measurements, %llu closures\n", graph->keyframes(),
                graph->solver().size(), graph->solver().measurements(),
                static_cast<unsigned long long>(graph->counters().closures));
    auto loaded = std::make_unique<slam::NavigationGraph>(graph_config);
    good = report("graph of 20,000 keyframes", *graph, buffer,
                  [&](rt::StateReader& reader) { return loaded->load(reader); }) &&
           good;
    for (const int k : graph->living())
      good = good && loaded->has(k) && loaded->pose(k).translation() == graph->pose(k).translation();
  }
  std::printf("%s\n", good ? "the same map and the same poses" : "NOT THE SAME");
  return good ? 0 : 1;
}

}  // namespace fathom::bench
