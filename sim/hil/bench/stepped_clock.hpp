#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fathom::sim {

// Steps the system's clock as one program sees it: a library laid over the C library's clock_gettime,
// gettimeofday, time and timespec_get (LD_PRELOAD) adds what this object says to CLOCK_REALTIME. Time
// namespaces of Linux cover the monotonic clocks only, and setting the machine's own clock would hit every
// other program on it. Not covered: sleeps to an absolute CLOCK_REALTIME, whose length stays as it was asked.
class SteppedClock {
 public:
  // `shared`: a file through which the program reads the step; made here. Throws std::runtime_error.
  explicit SteppedClock(const std::filesystem::path& shared);
  ~SteppedClock();
  SteppedClock(const SteppedClock&) = delete;
  SteppedClock& operator=(const SteppedClock&) = delete;

  // What the program must be started with; empty when the library is not there.
  [[nodiscard]] std::vector<std::string> environment() const;
  void step(double seconds);

 private:
  std::filesystem::path shared_;
  std::int64_t* offset_ns_ = nullptr;
};

}  // namespace fathom::sim
