#pragma once

namespace fathom::rt {

// Keeps the machine's CPUs out of idle states that take longer than a limit to leave, while it lives
// (/dev/cpu_dma_latency). A 100 Hz loop wakes from idle each time; 0 allows no idle state at all and costs a
// battery some watts, 10 us allows the shallow ones.
class CpuWakeLimit {
 public:
  // [us]; negative: leaves the machine as it is.
  explicit CpuWakeLimit(int microseconds) noexcept;
  ~CpuWakeLimit();
  CpuWakeLimit(const CpuWakeLimit&) = delete;
  CpuWakeLimit& operator=(const CpuWakeLimit&) = delete;

  // False where the system has no such thing or refuses it, or when not asked.
  [[nodiscard]] bool held() const noexcept { return file_ >= 0; }

 private:
  int file_ = -1;
};

}  // namespace fathom::rt
