#include "realtime/kernel/tiers/cpu_wake_limit.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cstdint>

namespace fathom::rt {

CpuWakeLimit::CpuWakeLimit(int microseconds) noexcept {
  if (microseconds < 0) return;
  file_ = ::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
  const std::int32_t limit = microseconds;
  // The limit holds for as long as the file is open.
  if (file_ >= 0 && ::write(file_, &limit, sizeof limit) != sizeof limit) {
    ::close(file_);
    file_ = -1;
  }
}

CpuWakeLimit::~CpuWakeLimit() {
  if (file_ >= 0) ::close(file_);
}

}  // namespace fathom::rt
