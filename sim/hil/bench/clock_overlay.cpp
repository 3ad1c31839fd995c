// Preloaded into a program under test: CLOCK_REALTIME is the machine's plus the offset in the file
// FATHOM_CLOCK_STEP (see program_under_test.hpp). Other clocks pass through.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <dlfcn.h>
#include <cstdint>
#include <cstdlib>

namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

const volatile std::int64_t* mapOffset() {
  static const std::int64_t kNone = 0;
  const char* path = ::getenv("FATHOM_CLOCK_STEP");
  const int fd = path != nullptr ? ::open(path, O_RDONLY | O_CLOEXEC) : -1;
  if (fd < 0) return &kNone;
  void* memory = ::mmap(nullptr, sizeof kNone, PROT_READ, MAP_SHARED, fd, 0);
  ::close(fd);
  return memory == MAP_FAILED ? &kNone : static_cast<const volatile std::int64_t*>(memory);
}

// Set when the library is loaded, so that the calls below never allocate.
const volatile std::int64_t* offset_ns = nullptr;
using ClockGettime = int (*)(clockid_t, timespec*);
ClockGettime real_clock_gettime = nullptr;

__attribute__((constructor)) void load() {
  real_clock_gettime = reinterpret_cast<ClockGettime>(::dlsym(RTLD_NEXT, "clock_gettime"));
  offset_ns = mapOffset();
}

int readClock(clockid_t clock, timespec* out) {
  const int result = real_clock_gettime != nullptr
                         ? real_clock_gettime(clock, out)
                         : static_cast<int>(::syscall(SYS_clock_gettime, clock, out));
  const bool stepped = clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE;
  if (result != 0 || !stepped || offset_ns == nullptr) return result;
  const std::int64_t ns = out->tv_sec * kNanosecondsPerSecond + out->tv_nsec + *offset_ns;
  out->tv_sec = ns / kNanosecondsPerSecond;
  out->tv_nsec = ns % kNanosecondsPerSecond;
  return 0;
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* out) noexcept {
  return readClock(clock, out);
}

int gettimeofday(timeval* out, void*) noexcept {
  timespec now{};
  const int result = readClock(CLOCK_REALTIME, &now);
  *out = {now.tv_sec, now.tv_nsec / 1000};
  return result;
}

time_t time(time_t* out) noexcept {
  timespec now{};
  readClock(CLOCK_REALTIME, &now);
  if (out != nullptr) *out = now.tv_sec;
  return now.tv_sec;
}

int timespec_get(timespec* out, int base) noexcept {
  return base == TIME_UTC && readClock(CLOCK_REALTIME, out) == 0 ? base : 0;
}

}  // extern "C"
