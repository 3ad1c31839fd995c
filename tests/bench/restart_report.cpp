// What a restart costs, along a mission of features: the size of the saved state, by part; the time in which
// the soft tier copies it; the time in which it is loaded into a program that has just begun; and whether it
// then is the same.
//
//   report_restart MISSION [times saved along the way, default 10]
//   report_restart                 the parts that grow, made as large as five hours make them
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/map/mesh_slot.hpp"
#include "realtime/onboard/slots/slot_file.hpp"
#include "recon/closure/feature_slot.hpp"
#include "tests/bench/restart_parts.hpp"
#include "tests/onboard/cores_run.hpp"
#include "tests/support/saved_state.hpp"

namespace {

using namespace fathom;
using namespace fathom::onboard;
using fathom::onboard::testing::CoresRun;
using fathom::onboard::testing::RecordedMission;
using fathom::onboard::testing::Ship;
using Clock = std::chrono::steady_clock;

constexpr double kMega = 1 << 20;

double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// The fastest and the slowest of some savings [ms].
struct Times {
  double least = 1e9, most = 0;
};

Times timeSaving(const CoresRun& run, std::span<std::uint8_t> buffer, std::size_t& bytes) {
  Times times;
  for (int k = 0; k < 5; ++k) {
    const auto start = Clock::now();
    rt::StateWriter writer(buffer);
    run.save(writer);
    const double ms = millisecondsSince(start);
    times = {std::min(times.least, ms), std::max(times.most, ms)};
    bytes = writer.full() ? 0 : writer.size();
  }
  return times;
}

void printParts(std::span<const std::uint8_t> state) {
  std::printf("parts [MiB]:");
  for (std::size_t at = 0; at < state.size();) {
    rt::StateSectionHead head;
    std::memcpy(&head, state.data() + at, sizeof head);
    std::array<char, 5> name{};
    std::memcpy(name.data(), &head.tag, 4);
    std::printf(" %s %.2f", name.data(), static_cast<double>(head.bytes) / kMega);
    at += sizeof head + head.bytes;
  }
  std::printf("\n");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return bench::reportRestartParts();
  const int times_saved = argc > 2 ? std::max(1, std::atoi(argv[2])) : 10;
  const RecordedMission mission(argv[1]);
  const auto folder = std::filesystem::temp_directory_path();
  SlotFile features(folder, static_cast<std::size_t>(mission.config.localisation.max_keyframes),
                    closure::slotBytes(closure::DescriptorKind::kRootSift,
                                       static_cast<std::size_t>(mission.config.localisation.features)));
  SlotFile meshes(folder, static_cast<std::size_t>(mission.config.max_pairs),
                  meshSlotBytes(static_cast<std::size_t>(mission.config.stereo.max_features)));
  Ship ship;
  CoresRun run(mission, {&features, &meshes}, ship);
  std::vector<std::uint8_t> buffer(std::size_t{512} << 20, 1);

  std::printf("%10s %8s %10s %8s %10s %10s %10s\n", "mission s", "pairs", "keyframes", "tiles", "state MiB",
              "save ms", "worst ms");
  const std::size_t all = mission.inputs.size();
  const std::int64_t first_ns = mission.inputs.front().arrival_utc_ns;
  std::size_t bytes = 0;
  for (std::size_t i = 0; i < all; ++i) {
    run.consume(mission.inputs[i]);
    if ((i + 1) * static_cast<std::size_t>(times_saved) / all ==
        i * static_cast<std::size_t>(times_saved) / all)
      continue;
    const Times times = timeSaving(run, buffer, bytes);
    const auto seconds = static_cast<double>(mission.inputs[i].arrival_utc_ns - first_ns) * 1e-9;
    std::printf("%10.0f %8llu %10d %8d %10.1f %10.1f %10.1f\n", seconds,
                static_cast<unsigned long long>(run.map().counters().pairs),
                run.map().localisation()->keyframes(), run.map().map().counters().tiles_used,
                static_cast<double>(bytes) / kMega, times.least, times.most);
    std::fflush(stdout);
  }
  const std::span<const std::uint8_t> state = std::span<const std::uint8_t>(buffer).first(bytes);
  printParts(state);

  CheckpointFiles files(folder / "report_restart");
  auto start = Clock::now();
  if (!files.write({1, 2, 1, all, mission.inputs.back().arrival_utc_ns}, state)) {
    std::fprintf(stderr, "report_restart: %s\n", files.error().c_str());
    return 1;
  }
  std::printf("written and on the disk in %.0f ms\n", millisecondsSince(start));
  start = Clock::now();
  std::vector<std::string> said;
  const auto found = files.readNewest(1, 2, said);
  std::printf("read and checked in %.0f ms\n", millisecondsSince(start));
  std::filesystem::remove_all(files.folder());

  start = Clock::now();
  auto loaded = std::make_unique<CoresRun>(mission, MapSlots{&features, &meshes}, ship);
  std::printf("cores made in %.0f ms\n", millisecondsSince(start));
  start = Clock::now();
  rt::StateReader reader(found->state);
  const bool good = loaded->load(reader);
  std::printf("loaded in %.0f ms%s\n", millisecondsSince(start), good ? "" : reader.failure());
  const bool same = good && loaded->map().map().canonicalBytes() == run.map().map().canonicalBytes() &&
                    test::savedState(*loaded) == found->state;
  std::printf("%s\n", same ? "the same map and the same state" : "NOT THE SAME");
  return same ? 0 : 1;
}
