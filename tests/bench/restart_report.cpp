// Cost of a restart, along a mission of features: size of the saved state by part; time to copy it in the
// soft tier and to load it into a new program; whether the loaded state is the same.
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "realtime/onboard/slots/slot_file.hpp"
#include "recon/closure/frame_features.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/reports.hpp"
#include "tests/onboard/cores_run.hpp"
#include "tests/support/saved_state.hpp"

namespace fathom::bench {
namespace {

using namespace fathom::onboard;
using onboard::testing::CoresRun, onboard::testing::RecordedMission, onboard::testing::Ship;

constexpr double kMega = 1 << 20;

// The fastest and the slowest of some savings [ms].
struct Times {
  double least = 1e9, most = 0;
};

Times timeSaving(const CoresRun& run, std::span<std::uint8_t> buffer, std::size_t& bytes) {
  Times times;
  for (int k = 0; k < 5; ++k) {
    const double start = wallMs();
    rt::StateWriter writer(buffer);
    run.save(writer);
    const double ms = wallMs() - start;
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

struct RestartOptions {
  std::filesystem::path mission;
  std::size_t saves = 10;
};

int runRestart(const RestartOptions& options) {
  const RecordedMission mission(options.mission);
  const auto folder = std::filesystem::temp_directory_path();
  SlotFile features(folder, static_cast<std::size_t>(mission.config.localisation.max_keyframes),
                    closure::slotBytes(static_cast<std::size_t>(mission.config.localisation.features)));
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
    if ((i + 1) * options.saves / all == i * options.saves / all) continue;
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

  CheckpointFiles files(folder / ("fathom-restart-" + std::to_string(::getpid())));
  double start = wallMs();
  if (!files.write({1, 2, 1, all, mission.inputs.back().arrival_utc_ns}, state)) {
    std::fprintf(stderr, "%s\n", files.error().c_str());
    return 1;
  }
  std::printf("written and on the disk in %.0f ms\n", wallMs() - start);
  start = wallMs();
  std::vector<std::string> said;
  const auto found = files.readNewest(1, 2, said);
  std::printf("read and checked in %.0f ms\n", wallMs() - start);
  std::filesystem::remove_all(files.folder());

  start = wallMs();
  auto loaded = std::make_unique<CoresRun>(mission, MapSlots{&features, &meshes}, ship);
  std::printf("cores made in %.0f ms\n", wallMs() - start);
  start = wallMs();
  rt::StateReader reader(found->state);
  const bool good = loaded->load(reader);
  std::printf("loaded in %.0f ms%s\n", wallMs() - start, good ? "" : reader.failure());
  const bool same = good && loaded->map().map().canonicalBytes() == run.map().map().canonicalBytes() &&
                    test::savedState(*loaded) == found->state;
  std::printf("%s\n", same ? "the same map and the same state" : "NOT THE SAME");
  return same ? 0 : 1;
}

}  // namespace

void restartReport(CommandLine& program) {
  static RestartOptions o;
  CommandLine& command = program.command(
      "restart", "What a restart costs along a mission: size of the saved state, time to save and to load it",
      "", [] { return runRestart(o); });
  command.add_option("mission", o.mission, "recorded mission")->required();
  command.shown("--saves", o.saves, "times saved along the mission", 1, 10000);
}

}  // namespace fathom::bench
