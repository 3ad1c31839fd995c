#include "realtime/kernel/health/system_status.hpp"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <sstream>
#include <string_view>

namespace fathom::rt {
namespace {

namespace fs = std::filesystem;

int openFile(const fs::path& path) {
  return ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
}

// Reads a small file of the kernel's from its beginning; without heap.
std::string_view contents(int file, char* buffer, std::size_t bytes) noexcept {
  const ssize_t got = file < 0 ? -1 : ::pread(file, buffer, bytes, 0);
  return got <= 0 ? std::string_view{} : std::string_view(buffer, static_cast<std::size_t>(got));
}

std::optional<std::int64_t> wholeNumber(int file) noexcept {
  char buffer[32];
  const std::string_view text = contents(file, buffer, sizeof buffer);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc{}) return std::nullopt;
  return value;
}

// Folders directly below `folder` with names of `prefix` and a digit, sorted.
std::vector<fs::path> numbered(const fs::path& folder, std::string_view prefix) {
  std::vector<fs::path> found;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.size() > prefix.size() && name.starts_with(prefix) && name[prefix.size()] >= '0' &&
        name[prefix.size()] <= '9')
      found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

SystemStatus::SystemStatus(const fs::path& watched_folder, const fs::path& root)
    : folder_(watched_folder.string()) {
  for (const fs::path& zone : numbered(root / "sys/class/thermal", "thermal_zone"))
    if (const int file = openFile(zone / "temp"); file >= 0) temperatures_.push_back(file);
  for (const fs::path& cpu : numbered(root / "sys/devices/system/cpu", "cpu")) {
    if (const int file = openFile(cpu / "thermal_throttle/core_throttle_count"); file >= 0)
      throttles_.push_back(file);
    const int highest = openFile(cpu / "cpufreq/cpuinfo_max_freq");
    const std::int64_t khz = wholeNumber(highest).value_or(0);
    if (highest >= 0) ::close(highest);
    if (khz <= 0) continue;
    if (const int file = openFile(cpu / "cpufreq/scaling_cur_freq"); file >= 0)
      frequencies_.push_back({file, khz});
  }
  load_ = openFile(root / "proc/loadavg");
}

SystemStatus::~SystemStatus() {
  for (const int file : temperatures_) ::close(file);
  for (const int file : throttles_) ::close(file);
  for (const Frequency& frequency : frequencies_) ::close(frequency.current);
  if (load_ >= 0) ::close(load_);
}

SystemFigures SystemStatus::read() const noexcept {
  SystemFigures figures;
  constexpr float kMilli = 1e-3F;
  for (const int file : temperatures_)
    if (const auto milli = wholeNumber(file))
      figures.cpu_temperature_c =
          std::max(figures.cpu_temperature_c.value_or(-273.0F), static_cast<float>(*milli) * kMilli);
  for (const int file : throttles_)
    if (const auto count = wholeNumber(file); count && *count >= 0)
      figures.thermal_throttles = figures.thermal_throttles.value_or(0) + static_cast<std::uint64_t>(*count);
  for (const Frequency& frequency : frequencies_)
    if (const auto khz = wholeNumber(frequency.current))
      figures.frequency_share =
          std::min(figures.frequency_share.value_or(1.0F),
                   static_cast<float>(*khz) / static_cast<float>(frequency.highest_khz));

  struct statvfs disk {};
  if (!folder_.empty() && ::statvfs(folder_.c_str(), &disk) == 0) {
    figures.disk_free_bytes = static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize;
    figures.disk_total_bytes = static_cast<std::uint64_t>(disk.f_blocks) * disk.f_frsize;
  }
  char buffer[64];
  const std::string_view text = contents(load_, buffer, sizeof buffer);
  float load = 0;
  if (std::from_chars(text.data(), text.data() + text.size(), load).ec == std::errc{} && !text.empty())
    figures.load = load;
  return figures;
}

double secondsSinceProgramStart() {
  // proc(5): the fields behind the program's name in parentheses, of which the start is the 20th [ticks].
  constexpr int kStart = 20;
  std::ifstream stat("/proc/self/stat"), uptime("/proc/uptime");
  std::string field;
  std::getline(stat, field, ')');
  double start = 0, now = 0;
  for (int k = 0; k < kStart; ++k) stat >> field;
  if (!(std::istringstream(field) >> start) || !(uptime >> now)) return 0;
  return now - start / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

}  // namespace fathom::rt
