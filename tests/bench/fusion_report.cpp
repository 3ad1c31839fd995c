// Report on the onboard map at a dive's size: its detail when the pool is full, and the cost of a closure.
//
// The dive: 36,000 pairs in five hours, 800 points each from 2 m, lines of 0.83 m over 7,500 m2; sand with
// reefs. The closure: 20,000 meshes in the map, of which 2,000 move by up to 0.5 m; a quota a pair; compared
// with a map built afresh. Times are of this thread's clock.
#include <cmath>
#include <cstdio>
#include <map>

#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/heap_counter.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/reports.hpp"
#include "tests/onboard/synthetic_survey.hpp"
#include "tests/world/ground.hpp"

namespace fathom::bench {
namespace {

constexpr double kAhead = 0.25, kBetweenLines = 0.833, kLine = 86.6;  // [m]: 36,000 steps cover 7,500 m2
constexpr double kGround = 2.0;                                       // range to the seafloor [m]

// Sand with ripples of a centimetre; every third 10 m square a reef of half a metre.
double seafloor(double n, double e) {
  const double reef = std::max(0.0, std::sin(n * 0.21) * std::sin(e * 0.21) - 0.3);
  return 20 + 0.02 * n + 0.01 * std::sin(9 * e) + reef * (0.5 * std::sin(3.1 * n) * std::cos(2.7 * e) - 0.4);
}

Eigen::Vector2d placeOf(int pair) {
  const auto steps = static_cast<int>(kLine / kAhead);
  const int line = pair / steps, step = pair % steps;
  return {kAhead * (line % 2 == 0 ? step : steps - step), kBetweenLines * line};
}

SE3 truePoseOf(int pair) {
  const Eigen::Vector2d p = placeOf(pair);
  return SE3(Eigen::Quaterniond::Identity(), {p.x(), p.y(), 20 - kGround});
}

// Of a camera that looks straight down: 29 x 28 points, in nav.
Mesh meshOf(int pair) {
  const Eigen::Vector2d p = placeOf(pair);
  return test::rangeMesh(
      {.north = p.x(), .east = p.y(), .length = 1.2, .width = 1.6, .spacing = 0.049, .sigma = 0.01}, seafloor,
      static_cast<unsigned>(pair));
}

void printMap(const fusion::QuadtreeMap& map, const fusion::QuadtreeConfig& config) {
  struct Share {
    double area = 0, squares = 0;
    std::size_t nodes = 0;
  };
  std::map<int, Share> shares;
  HeightTile tile;
  map.forEachLeaf([&](const fusion::TileKey& key, std::uint32_t) {
    if (!map.extract(key, tile)) return;
    Share& share = shares[key.level];
    for (int i = 0; i < HeightTile::kCells; ++i)
      for (int j = 0; j < HeightTile::kCells; ++j) {
        if (tile.at(i, j).coverage < 0.5F) continue;
        const double error = static_cast<double>(tile.at(i, j).depth) -
                             seafloor(tile.north0() + i * tile.spacing(), tile.east0() + j * tile.spacing());
        share.area += tile.spacing() * tile.spacing();
        share.squares += error * error;
        ++share.nodes;
      }
  });
  double total = 0;
  for (const auto& [level, share] : shares) total += share.area;
  for (const auto& [level, share] : shares)
    std::printf("    %7.4f m: %6.0f m2 (%4.1f %%), rms %.4f m\n", config.root_size / 16 / (1 << level),
                share.area, 100 * share.area / total,
                std::sqrt(share.squares / static_cast<double>(share.nodes)));
}

void dive(const fusion::QuadtreeConfig& config, int pairs) {
  fusion::QuadtreeMap map(config);
  std::printf("dive of %d pairs, finest cells %.4f m, %d tiles, %.1f MiB in all\n", pairs,
              config.root_size / 16 / (1 << config.max_level), config.max_tiles,
              mebibytes(map.counters().memory_bytes));
  double worst = 0, sum = 0;
  std::uint64_t heap_calls = 0;
  for (int pair = 0; pair < pairs; ++pair) {
    const Mesh mesh = meshOf(pair);
    map.noteVehicle(placeOf(pair));
    const rt::ThreadCost before = rt::threadCost();
    const double begin = cpuMs();
    (void)map.fuse(mesh);
    const double took = cpuMs() - begin;
    heap_calls += (rt::threadCost() - before).heap_calls;
    worst = std::max(worst, took);
    sum += took;
    if ((pair + 1) % (pairs / 5) != 0) continue;
    const fusion::QuadtreeMap::Counters c = map.counters();
    std::printf(
        "  pair %d: %d tiles, %d of %d layers, %llu coarsened, %llu refused; fuse mean %.2f ms, worst %.2f "
        "ms\n",
        pair + 1, c.tiles_used, c.layers_used, c.layers, static_cast<unsigned long long>(c.coarsened),
        static_cast<unsigned long long>(c.refused), sum / (pair + 1), worst);
    printMap(map, config);
  }
  std::printf("  heap calls: %llu\n", static_cast<unsigned long long>(heap_calls));
}

// True when the maps are equal in the end and the quota held.
bool closure(fusion::QuadtreeConfig config, int meshes, int moved, int quota) {
  constexpr std::size_t kPoints = 1000;
  config.max_tiles = 4 * config.max_tiles;  // all fits: maps that coarsened need not be equal
  onboard::testing::MemorySlots slots(static_cast<std::size_t>(meshes), onboard::meshSlotBytes(kPoints));
  const calibration::RigHistory rigs{StereoRig{}};
  onboard::MovingMap map(config, &slots, kPoints, rigs);
  bool closed = false;
  // The last lines are shifted, as before a closure.
  const onboard::MovingMap::PoseOf pose_of = [&](int pair, const SE3& T) {
    const double share = static_cast<double>(pair - (meshes - moved)) / moved;
    return closed && share > 0
               ? SE3::fromEuler(0, 0, 0.01 * share, {0.4 * share, -0.3 * share, 0.02 * share}) * T
               : T;
  };
  const auto inCamera = [&](int pair) {
    Mesh mesh = meshOf(pair);
    transform(mesh, truePoseOf(pair).inverse());
    return mesh;
  };
  for (int pair = 0; pair < meshes; ++pair) {
    Mesh mesh = inCamera(pair);
    (void)map.add(mesh, pair, truePoseOf(pair), truePoseOf(pair));
  }
  closed = true;
  (void)map.noteMoved();
  double worst = 0, sum = 0;
  std::uint64_t heap_calls = 0, most = 0;
  int calls = 0;
  for (; calls == 0 || map.counters().waiting > 0 || calls < 2 + meshes / 2048; ++calls) {
    const std::uint64_t before = map.counters().meshes_fused_again;
    const rt::ThreadCost cost = rt::threadCost();
    const double begin = cpuMs();
    map.rebuild(quota, pose_of, {});
    const double took = cpuMs() - begin;
    heap_calls += (rt::threadCost() - cost).heap_calls;
    most = std::max(most, map.counters().meshes_fused_again - before);
    worst = std::max(worst, took);
    sum += took;
  }
  const std::uint64_t in_time = map.counters().meshes_fused_again;
  map.finish(pose_of, {});
  fusion::QuadtreeMap fresh(config);
  for (int pair = 0; pair < meshes; ++pair) {
    Mesh mesh = inCamera(pair);
    transform(mesh, pose_of(pair, truePoseOf(pair)));
    (void)fresh.fuse(mesh);
  }
  const bool equal = map.map().canonicalBytes() == fresh.canonicalBytes();
  const bool held = most <= static_cast<std::uint64_t>(quota);
  std::printf(
      "closure that moves %d of %d meshes, quota %d: %llu fused again in %d pairs (most at once %llu), %.2f "
      "ms a pair "
      "(worst %.2f), %llu heap calls; %llu at the end; coarsened %llu; equal to a map built afresh: %s\n",
      moved, meshes, quota, static_cast<unsigned long long>(in_time), calls,
      static_cast<unsigned long long>(most), sum / calls, worst, static_cast<unsigned long long>(heap_calls),
      static_cast<unsigned long long>(map.counters().meshes_fused_again - in_time),
      static_cast<unsigned long long>(map.map().counters().coarsened), equal ? "yes" : "NO");
  return equal && held && heap_calls == 0;
}

struct FusionOptions {
  fusion::QuadtreeConfig config{.max_level = 6, .max_tiles = 8192};
  int pairs = 36000, meshes = 20000, moved = 2000, quota = 6;
};

}  // namespace

void fusionReport(CommandLine& program) {
  static FusionOptions o;
  CommandLine& command = program.command(
      "fusion", "The onboard map at a dive's size: its full pool, and what a closure costs", "", [] {
        if (o.pairs > 0) dive(o.config, o.pairs);
        return o.meshes == 0 || closure(o.config, o.meshes, o.moved, o.quota) ? 0 : 1;
      });
  command.shown("--max-level", o.config.max_level, "finest level of 32 m roots");
  command.shown("--max-tiles", o.config.max_tiles, "of the pool");
  command.shown("--ratio", o.config.node_spacing_ratio, "cells over point spacing");
  command.shown("--layers", o.config.layers_per_tile, "of a tile");
  command.shown("--pairs", o.pairs, "of the dive; 0: none");
  command.shown("--meshes", o.meshes, "of the closure; 0: none");
  command.shown("--moved", o.moved, "of these");
  command.shown("--quota", o.quota, "meshes fused again a pair");
}

}  // namespace fathom::bench
