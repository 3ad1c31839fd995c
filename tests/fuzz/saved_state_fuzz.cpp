// Saved state of every small part, from any bytes; and a checkpoint file. Checksums are put right, so that
// the checks behind them are met; what loads must also live on.

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/nav/nav_core.hpp"
#include "recon/fusion/quadtree_map.hpp"
#include "recon/navigation/graph/navigation_graph.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"

namespace {

using fathom::rt::StateReader;

// The sections' lengths and checksums, as a writer writes them.
void seal(std::vector<std::uint8_t>& bytes) {
  for (std::size_t at = 0; at + sizeof(fathom::rt::StateSectionHead) <= bytes.size();) {
    fathom::rt::StateSectionHead head;
    std::memcpy(&head, bytes.data() + at, sizeof head);
    const std::size_t first = at + sizeof head;
    head.bytes = std::min<std::uint64_t>(head.bytes, bytes.size() - first);
    head.crc = fathom::crc32(std::span<const std::uint8_t>(bytes).subspan(first, head.bytes));
    std::memcpy(bytes.data() + at, &head, sizeof head);
    at = first + head.bytes;
  }
}

void loadNavigation(StateReader& reader) {
  auto feed = std::make_unique<fathom::onboard::NavFeed>(fathom::onboard::NavCoreConfig());
  if (!feed->load(reader)) return;
  fathom::DepthSample depth{.utc_ns = 1'800'000'000'000'000'000};
  feed->add(depth);
  feed->tick(depth.utc_ns);
  while (feed->core().pollTrigger()) continue;
}

void loadMap(StateReader& reader) {
  fathom::fusion::QuadtreeMap map(fathom::fusion::QuadtreeConfig{.root_size = 16, .max_tiles = 16});
  if (!map.load(reader)) return;
  fathom::Mesh mesh;
  mesh.vertices = {{0, 0, 8}, {1, 0, 8}, {0, 1, 8}};
  mesh.triangles = {{0, 1, 2}};
  (void)map.fuse(mesh);
  (void)toMesh(map);
}

void loadGraph(StateReader& reader) {
  fathom::slam::NavigationConfig config;
  config.max_keyframes = 20;
  config.max_links = 20;
  config.max_fixes = 10;
  fathom::slam::NavigationGraph graph(config);
  if (!graph.load(reader)) return;
  (void)graph.addKeyframe({});
  (void)graph.step();
}

void loadLink(StateReader& reader) {
  fathom::telemetry::LinkSchedulerConfig config;
  config.blocks.max_squares = 4;
  fathom::telemetry::LinkScheduler link(config);
  if (!link.load(reader)) return;
  std::array<std::uint8_t, fathom::telemetry::kMaxFrameBytes> frame;
  for (int k = 0; k < 8; ++k) (void)link.nextFrame(1'800'000'000'000'000'000 + k * 10'000'000'000, frame);
}

void loadDownlink(StateReader& reader) {
  fathom::telemetry::DownlinkReceiver ear({1, 2}, std::nullopt, 0);
  if (ear.load(reader)) (void)ear.accept(1, std::array<std::uint8_t, 4>{});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  std::vector<std::uint8_t> bytes(data + 1, data + size);
  fathom::onboard::CheckpointHead head;
  std::span<const std::uint8_t> state;
  (void)fathom::onboard::decodeCheckpoint(bytes, head, state);
  seal(bytes);
  StateReader reader(bytes);
  constexpr std::array kParts{&loadNavigation, &loadMap, &loadGraph, &loadLink, &loadDownlink};
  kParts[data[0] % kParts.size()](reader);
  return 0;
}
