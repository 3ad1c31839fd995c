#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fathom::rt {

// Readings of the machine; absent where it gives none.
struct SystemFigures {
  std::optional<float> cpu_temperature_c;        // the hottest thermal zone
  std::optional<std::uint64_t> disk_free_bytes;  // of the folder watched, for an ordinary user
  std::optional<std::uint64_t> disk_total_bytes;
  std::optional<float> load;                       // runnable tasks, mean over a minute
  std::optional<float> frequency_share;            // slowest CPU's frequency over its highest, 0 to 1
  std::optional<std::uint64_t> thermal_throttles;  // since the machine started, all CPUs
};

// Opens the system's files once and reads them without heap. One thread.
class SystemStatus {
 public:
  // `root` stands before /sys and /proc: "/" but for tests.
  explicit SystemStatus(const std::filesystem::path& watched_folder, const std::filesystem::path& root = "/");
  ~SystemStatus();
  SystemStatus(const SystemStatus&) = delete;
  SystemStatus& operator=(const SystemStatus&) = delete;

  [[nodiscard]] SystemFigures read() const noexcept;

 private:
  struct Frequency {
    int current = -1;
    std::int64_t highest_khz = 0;
  };
  std::string folder_;
  std::vector<int> temperatures_, throttles_;  // files
  std::vector<Frequency> frequencies_;
  int load_ = -1;
};

// Since this program was started, by the system's clock of 10 ms; 0 where /proc gives none [s].
[[nodiscard]] double secondsSinceProgramStart();

}  // namespace fathom::rt
