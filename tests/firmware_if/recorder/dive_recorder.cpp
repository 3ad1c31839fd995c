// Records the synthetic dive in real time until it ends or is ended, as the onboard program records: one
// thread offers, one writes. On its output a line every 50 ms, synced to the disk where asked: monotonic time
// [ms], number behind the last input offered, number behind the last input that the disk holds.

#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <thread>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/command_line.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"

namespace {

using fathom::kMillisecond_ns, fathom::io::Recorder, fathom::test::SyntheticDive;

// Where the dive stands after what an earlier run recorded: it went on meanwhile.
std::uint64_t nextNumber(const std::filesystem::path& folder) {
  fathom::io::LogInputReader log(folder);
  fathom::io::LogInputReader::Entry entry;
  while (log.next(entry) < fathom::io::LogInputReader::Step::kEnd) continue;
  if (log.position() == 0) return 0;
  return static_cast<std::uint64_t>((entry.input.arrival_utc_ns - SyntheticDive::kStartUtcNs) /
                                    SyntheticDive::kInputIntervalNs) +
         1 + SyntheticDive::kRestartInputs;
}

void say(const char* line, bool durable) {
  (void)!::write(STDOUT_FILENO, line, std::char_traits<char>::length(line));
  if (durable) (void)::fdatasync(STDOUT_FILENO);
}

}  // namespace

int main(int argc, char** argv) {
  std::filesystem::path folder;
  SyntheticDive::Config dive_config;
  double seconds = 1e9, speed = 1, sync_interval_s = 0.5;
  bool durable_status = false;
  fathom::CommandLine app("records the synthetic dive", "", [&] {
    const SyntheticDive dive(dive_config);
    const std::uint64_t first = nextNumber(folder);
    fathom::test::DivePlayer player(dive, dive_config, 12);
    fathom::io::RecorderConfig config;
    config.planned_hours = 0.1;
    config.image_reserve_mib = 4;
    config.log_reserve_mib = 1;
    config.image_queue = 4;
    config.sync_interval_s = sync_interval_s;
    Recorder recorder(folder, dive.mission(), dive.rig(), config, player.viewOf(), player.release());

    const Recorder::Found& found = recorder.found();
    std::fprintf(stderr, "found %llu %llu %llu %llu\n", static_cast<unsigned long long>(found.log_bytes),
                 static_cast<unsigned long long>(found.log_bytes_cut),
                 static_cast<unsigned long long>(found.images_without_event),
                 static_cast<unsigned long long>(found.half_images_removed));

    std::atomic<bool> ended{false};
    std::thread writer([&] {
      fathom::rt::RealClock clock;
      while (!ended) {
        recorder.work(50);
        clock.sleepUntil(clock.monotonicNs() + 20 * kMillisecond_ns);
      }
    });
    fathom::rt::RealClock clock;
    const std::int64_t start = clock.monotonicNs();
    const auto interval = static_cast<std::int64_t>(SyntheticDive::kInputIntervalNs / speed);
    std::int64_t next_line = start;
    std::uint64_t refused = 0;
    for (std::uint64_t n = 0; clock.monotonicNs() - start < static_cast<std::int64_t>(seconds * 1e9); ++n) {
      refused += player.offer(recorder, first + n) ? 0 : 1;
      const std::int64_t now = clock.monotonicNs();
      if (now >= next_line) {
        char line[96];
        std::snprintf(line, sizeof line, "%lld %llu %llu\n", static_cast<long long>(now / kMillisecond_ns),
                      static_cast<unsigned long long>(first + n + 1),
                      static_cast<unsigned long long>(first + recorder.counters().inputs_safe));
        say(line, durable_status);
        next_line = now + 50 * kMillisecond_ns;
      }
      clock.sleepUntil(start + static_cast<std::int64_t>(n + 1) * interval);
    }
    ended = true;
    writer.join();
    const Recorder::CloseResult closed = recorder.close(60);
    if (!closed.log_whole) std::fprintf(stderr, "%s\n", closed.text.c_str());
    const Recorder::Counters c = recorder.counters();
    std::fprintf(
        stderr,
        "inputs %llu (%llu refused), images %llu (%llu for the queue, %llu for the disk), syncs %llu, worst "
        "sync %.1f ms, worst unsafe %.1f ms\n",
        static_cast<unsigned long long>(c.inputs), static_cast<unsigned long long>(refused),
        static_cast<unsigned long long>(c.images), static_cast<unsigned long long>(c.images_dropped_queue),
        static_cast<unsigned long long>(c.images_dropped_disk), static_cast<unsigned long long>(c.syncs),
        static_cast<double>(c.worst_sync_ns) * 1e-6, static_cast<double>(c.worst_unsafe_ns) * 1e-6);
    return closed.log_whole ? 0 : 1;
  });
  app.add_option("folder", folder)->required();
  app.add_option("--width", dive_config.width, "of an image [px]");
  app.add_option("--height", dive_config.height, "of an image [px]");
  app.add_option("--seconds", seconds, "then the recording is closed");
  app.add_option("--speed", speed, "1: 100 inputs and two pairs a second");
  app.add_option("--sync-interval", sync_interval_s, "[s]");
  app.add_flag("--durable-status", durable_status, "each line is synced to the disk");
  return app.run("dive_recorder", argc, argv);
}
