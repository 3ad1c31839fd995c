#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fathom::sim {

// Steps the system's clock for one program: a preloaded library replaces clock_gettime, gettimeofday, time
// and timespec_get and adds this object's offset to CLOCK_REALTIME. (Linux time namespaces cover the
// monotonic clocks only, and setting the machine's clock would affect every other program.) Sleeps to an
// absolute CLOCK_REALTIME keep their length.
class SteppedClock {
 public:
  // Creates the file `shared`, from which the program reads the offset. Throws std::runtime_error.
  explicit SteppedClock(const std::filesystem::path& shared);
  ~SteppedClock();
  SteppedClock(const SteppedClock&) = delete;
  SteppedClock& operator=(const SteppedClock&) = delete;

  // Environment variables for the program; empty without the library.
  [[nodiscard]] std::vector<std::string> environment() const;
  void step(double seconds);

 private:
  std::filesystem::path shared_;
  std::int64_t* offset_ns_ = nullptr;
};

}  // namespace fathom::sim
