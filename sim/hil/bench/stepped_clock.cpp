#include "sim/hil/bench/stepped_clock.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <stdexcept>
#include <system_error>

#include "realtime/base/install_prefix.hpp"
#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

constexpr const char* kLibrary = "lib/fathom/libfathom_stepped_clock.so";

}  // namespace

SteppedClock::SteppedClock(const std::filesystem::path& shared) : shared_(std::filesystem::absolute(shared)) {
  const int fd = ::open(shared_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  void* memory = MAP_FAILED;
  if (fd >= 0 && ::ftruncate(fd, sizeof *offset_ns_) == 0)
    memory = ::mmap(nullptr, sizeof *offset_ns_, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (fd >= 0) ::close(fd);
  if (memory == MAP_FAILED) throw std::runtime_error(shared_.string() + " cannot be shared with a program");
  offset_ns_ = static_cast<std::int64_t*>(memory);
}

SteppedClock::~SteppedClock() {
  ::munmap(offset_ns_, sizeof *offset_ns_);
  std::error_code ignored;
  std::filesystem::remove(shared_, ignored);
}

std::vector<std::string> SteppedClock::environment() const {
  const auto library = installPrefix() / kLibrary;
  if (!std::filesystem::exists(library)) return {};
  return {"LD_PRELOAD=" + library.string(), "FATHOM_CLOCK_STEP=" + shared_.string()};
}

void SteppedClock::step(double seconds) {
  std::atomic_ref<std::int64_t>(*offset_ns_).fetch_add(rt::nanoseconds(seconds));
}

}  // namespace fathom::sim
