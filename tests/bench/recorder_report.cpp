// Cost of recording: full-size pairs at 2 Hz, 100 inputs and 200 raw entries a second, in real time; CPU of
// the recorder's thread, the longest offer, how long inputs were unsafe, and what an hour of log takes. Peers
// on the same pairs: writeImage (libtiff, deflate), and the bytes alone written and synced.

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <thread>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "realtime/base/numbers/log_histogram.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/reports.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"

namespace fathom::bench {
namespace {

using fathom::test::SyntheticDive;

// Part of the folder's files in the system's page cache [MiB].
double cachedMib(const std::filesystem::path& folder) {
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  std::size_t pages = 0;
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    const int fd = ::open(file.path().c_str(), O_RDONLY);
    const std::size_t size = std::filesystem::file_size(file.path());
    void* memory = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, fd, 0);
    ::close(fd);
    if (memory == MAP_FAILED) continue;
    std::vector<unsigned char> resident((size + page - 1) / page);
    if (::mincore(memory, size, resident.data()) == 0)
      for (const unsigned char r : resident) pages += r & 1;
    ::munmap(memory, size);
  }
  return static_cast<double>(pages * page) / kMebibyte;
}

struct Sizes {
  int width = 1360, height = 1024;  // [px]
  double seconds = 20;
};

// One exposure in a block that lives as long as the program; frames of one camera share it.
class OneImage {
 public:
  OneImage(const SyntheticDive& dive, const Sizes& sizes, CameraSide side)
      : pixels_(dive.pixels({SyntheticDive::kStartUtcNs, side, {}, 0})) {
    // As of a camera: 12 bits of which the lowest are noise on a slope, not noise alone.
    for (std::size_t i = 0; i < pixels_.size(); ++i)
      pixels_[i] =
          static_cast<std::uint16_t>(800 + i % static_cast<std::size_t>(sizes.width) + pixels_[i] % 64);
    view_ = {pixels_.data(),     sizes.width, sizes.height, 2 * static_cast<std::size_t>(sizes.width),
             PixelFormat::kMono, 12};
  }
  [[nodiscard]] const ImageView& view() const { return view_; }
  [[nodiscard]] std::size_t bytes() const { return 2 * pixels_.size(); }

 private:
  std::vector<std::uint16_t> pixels_;
  ImageView view_;
};

// Cost of one recording; histograms are of offers [ns].
struct RecordingCost {
  rt::LogHistogram input_ns, image_ns, raw_ns;
  std::uint64_t refused = 0;
  double cpu_ms = 0, cached_mib = 0;
};

void printRecording(const RecordingCost& m, const io::Recorder::Counters& c, const Sizes& sizes,
                    std::size_t image_bytes) {
  const double pairs = static_cast<double>(c.images) / 2;
  std::printf(
      "recorder, %.0f s: %.0f pairs of %d x %d, %llu inputs, %llu raw entries; refused or dropped %llu\n",
      sizes.seconds, pairs, sizes.width, sizes.height, static_cast<unsigned long long>(c.inputs),
      static_cast<unsigned long long>(c.raw_entries),
      static_cast<unsigned long long>(m.refused + c.images_dropped_disk + c.images_dropped_queue));
  std::printf("  CPU of its thread      %6.2f %% of a core, %.2f ms a pair with the inputs beside it\n",
              m.cpu_ms / sizes.seconds / 10, m.cpu_ms / pairs);
  for (const auto& [name, histogram] :
       {std::pair("input", &m.input_ns), std::pair("image", &m.image_ns), std::pair("raw", &m.raw_ns)})
    std::printf("  offer of %-5s          p50 %.2f us, p99.9 %.2f us, most %.2f us (%llu)\n", name,
                static_cast<double>(histogram->percentile(50)) * 1e-3,
                static_cast<double>(histogram->percentile(99.9)) * 1e-3,
                static_cast<double>(histogram->max()) * 1e-3,
                static_cast<unsigned long long>(histogram->count()));
  std::printf("  unsafe at most         %6.1f ms; %llu syncs of the log, the longest %.1f ms\n",
              static_cast<double>(c.worst_unsafe_ns) * 1e-6, static_cast<unsigned long long>(c.syncs),
              static_cast<double>(c.worst_sync_ns) * 1e-6);
  const double log_bytes =
      static_cast<double>(c.bytes) - static_cast<double>(c.images) * static_cast<double>(image_bytes + 4096);
  std::printf("  written                %6.1f MiB of images, log %.1f MiB an hour\n",
              static_cast<double>(c.images) * static_cast<double>(image_bytes) / kMebibyte,
              log_bytes / kMebibyte / sizes.seconds * 3600);
  std::printf("  images in page cache   %6.1f MiB; most waiting: %zu inputs, %zu images of a camera\n",
              m.cached_mib, c.input_high_water, c.image_high_water);
}

void live(const std::filesystem::path& folder, const SyntheticDive& dive, const Sizes& sizes,
          const OneImage& image) {
  io::RecorderConfig config{.planned_hours = 1, .image_reserve_mib = 0, .log_reserve_mib = 0};
  std::atomic<std::uint64_t> released{0};
  io::Recorder recorder(
      folder, dive.mission(), dive.rig(), config, [&](const io::CameraFrame&) { return image.view(); },
      [&](const io::CameraFrame&) { ++released; });
  std::atomic<bool> ended{false};
  RecordingCost measured;
  std::thread writer([&] {
    rt::RealClock clock;
    const double before = cpuMs();
    while (!ended) {
      recorder.work(50);
      clock.sleepUntil(clock.monotonicNs() + 20 * kMillisecond_ns);
    }
    measured.cpu_ms = cpuMs() - before;
  });
  rt::RealClock clock;
  const std::vector<std::uint8_t> can(24, 0x5a), pd0(650, 0x7f);
  const std::int64_t start = clock.monotonicNs();
  const auto timed = [&](rt::LogHistogram& histogram, const auto& offer) {
    const std::int64_t before = clock.monotonicNs();
    const bool good = offer();
    histogram.add(clock.monotonicNs() - before);
    return good;
  };
  const auto inputs = static_cast<std::uint64_t>(sizes.seconds * 100);
  for (std::uint64_t n = 0; n < inputs; ++n) {
    clock.sleepUntil(start + static_cast<std::int64_t>(n) * SyntheticDive::kInputIntervalNs);
    const io::OnboardInput input = dive.input(n);
    if (const ImageEvent* event = io::imageOf(input)) {
      io::CameraFrame frame{.side = event->side, .utc_ns = event->utc_ns};
      measured.refused += timed(measured.image_ns, [&] { return recorder.offerImage(frame); }) ? 0 : 1;
    }
    measured.refused += timed(measured.input_ns, [&] { return recorder.offerInput(input); }) ? 0 : 1;
    for (int i = 0; i < 2; ++i)
      measured.refused +=
          timed(measured.raw_ns, [&] { return recorder.offerRaw(0, input.arrival_utc_ns, "RAW_CAN", can); })
              ? 0
              : 1;
    if (n % 20 == 2)
      measured.refused +=
          timed(measured.raw_ns, [&] { return recorder.offerRaw(1, input.arrival_utc_ns, "RAW_DVL", pd0); })
              ? 0
              : 1;
  }
  ended = true;
  writer.join();
  measured.cached_mib = cachedMib(folder / "img");
  (void)recorder.close(60);
  printRecording(measured, recorder.counters(), sizes, image.bytes());
}

void peers(const std::filesystem::path& folder, const OneImage& image) {
  constexpr int kPairs = 10;
  {
    const double before = cpuMs();
    for (int i = 0; i < 2 * kPairs; ++i)
      io::writeImage(folder / ("deflate" + std::to_string(i) + ".tif"), image.view());
    std::printf("peer writeImage          %6.2f ms of CPU a pair (libtiff, deflate)\n",
                (cpuMs() - before) / kPairs);
  }
  const double before = cpuMs();
  for (int i = 0; i < 2 * kPairs; ++i) {
    const int fd =
        ::open((folder / ("plain" + std::to_string(i))).c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    if (fd < 0 || ::write(fd, image.view().data, image.bytes()) != static_cast<ssize_t>(image.bytes()) ||
        ::fdatasync(fd) != 0)
      std::printf("the plain file cannot be written\n");
    ::close(fd);
  }
  std::printf("peer write and fdatasync %6.2f ms of CPU a pair\n", (cpuMs() - before) / kPairs);
}

struct RecorderOptions {
  Sizes sizes;
  std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("fathom-recorder-" + std::to_string(::getpid()));
};

int runRecorder(const RecorderOptions& o) {
  const SyntheticDive dive({o.sizes.width, o.sizes.height, 50});
  const OneImage image(dive, o.sizes, CameraSide::kLeft);
  std::filesystem::create_directories(o.folder);
  live(o.folder / "live", dive, o.sizes, image);
  peers(o.folder, image);
  std::filesystem::remove_all(o.folder);
  return 0;
}

}  // namespace

void recorderReport(CommandLine& program) {
  static RecorderOptions o;
  CommandLine& command =
      program.command("recorder", "Cost of recording: full-size pairs at 2 Hz onto the disk", "",
                      [] { return runRecorder(o); });
  command.shown("--seconds", o.sizes.seconds, "of the recording", 1, 1e5);
  command.shown("--width", o.sizes.width, "of an image [px]");
  command.shown("--height", o.sizes.height, "of an image [px]");
  command.add_option("--folder", o.folder, "on the disk to be measured; removed afterwards");
}

}  // namespace fathom::bench
