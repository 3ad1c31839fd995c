#include "realtime/kernel/threads/rt_thread.hpp"

#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <exception>
#include <new>
#include <system_error>
#include <utility>

#include "realtime/base/units.hpp"

namespace fathom::rt {
namespace {

constexpr std::size_t kLongestName = 15;  // of a Linux thread, without the final zero
// glibc puts thread-local storage on the stack too; below this a thread may not start at all.
constexpr std::size_t kSmallestStack = 64 * 1024;

std::size_t pageBytes() {
  return static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

std::string reason(int error) {
  return std::generic_category().message(error);
}

}  // namespace

void restFor(std::int64_t ns) noexcept {
  const timespec rest = {static_cast<time_t>(ns / kSecond_ns), static_cast<long>(ns % kSecond_ns)};
  ::clock_nanosleep(CLOCK_MONOTONIC, 0, &rest, nullptr);
}

std::vector<std::string> applyThreadConfig(const ThreadConfig& config) {
  std::vector<std::string> refused;
  ::pthread_setname_np(::pthread_self(), config.name.substr(0, kLongestName).c_str());
  if (!config.cpus.empty()) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    std::string list;
    for (const int cpu : config.cpus) {
      if (cpu >= 0 && cpu < CPU_SETSIZE) CPU_SET(static_cast<std::size_t>(cpu), &cpus);
      list += (list.empty() ? "" : ",") + std::to_string(cpu);
    }
    if (const int error = ::pthread_setaffinity_np(::pthread_self(), sizeof cpus, &cpus); error != 0)
      refused.push_back("CPU " + list + ": " + reason(error));
  }
  sched_param parameters{};
  if (config.fifo_priority > 0) {
    parameters.sched_priority = config.fifo_priority;
    if (const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters); error != 0)
      refused.push_back("SCHED_FIFO " + std::to_string(config.fifo_priority) + ": " + reason(error));
  } else {
    // A thread inherits its maker's policy; a best-effort one must not stay in real time by that.
    if (const int error = ::pthread_setschedparam(::pthread_self(), SCHED_OTHER, &parameters); error != 0)
      refused.push_back("SCHED_OTHER: " + reason(error));
    const auto id = static_cast<id_t>(::syscall(SYS_gettid));
    errno = 0;
    const int before = ::getpriority(PRIO_PROCESS, id);
    if ((before != config.nice || errno != 0) && ::setpriority(PRIO_PROCESS, id, config.nice) != 0)
      refused.push_back("nice " + std::to_string(config.nice) + ": " + reason(errno));
  }
  return refused;
}

RtThread::RtThread(ThreadConfig config) : config_(std::move(config)) {
  const std::size_t page = pageBytes();
  stack_bytes_ = (std::max(config_.stack_bytes, kSmallestStack) + page - 1) / page * page;
  mapping_bytes_ = stack_bytes_ + page;
  void* memory =
      ::mmap(nullptr, mapping_bytes_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK, -1, 0);
  if (memory == MAP_FAILED)
    throw std::system_error(
        errno, std::generic_category(),
        "thread " + config_.name + ": no memory for a stack of " + std::to_string(stack_bytes_) + " bytes");
  mapping_ = static_cast<std::byte*>(memory);
  // A huge page would take whole 2 MiB and hide the guard's neighbour from the budget.
  ::madvise(mapping_, mapping_bytes_, MADV_NOHUGEPAGE);
  ::mprotect(mapping_, page, PROT_NONE);
  for (std::size_t offset = page; offset < mapping_bytes_; offset += page)
    *static_cast<volatile std::byte*>(mapping_ + offset) = std::byte{0};
}

RtThread::~RtThread() {
  join();
  ::munmap(mapping_, mapping_bytes_);
}

bool RtThread::start(std::function<void()> body) {
  if (running()) return false;
  join();
  body_ = std::move(body);
  refused_.clear();
  failure_.clear();
  ready_.store(false, std::memory_order_relaxed);

  pthread_attr_t attributes;
  if (::pthread_attr_init(&attributes) != 0) return false;
  ::pthread_attr_setstack(&attributes, mapping_ + pageBytes(), stack_bytes_);
  running_.store(true, std::memory_order_release);
  const int error = ::pthread_create(&thread_, &attributes, &RtThread::enter, this);
  ::pthread_attr_destroy(&attributes);
  if (error != 0) {
    refused_.push_back("thread: " + reason(error));
    running_.store(false, std::memory_order_release);
    return false;
  }
  joinable_ = true;
  ++starts_;
  ready_.wait(false, std::memory_order_acquire);
  return true;
}

void RtThread::join() noexcept {
  if (!joinable_) return;
  ::pthread_join(thread_, nullptr);
  joinable_ = false;
}

void* RtThread::enter(void* self) {
  auto& thread = *static_cast<RtThread*>(self);
  thread.fenced([&] { thread.refused_ = applyThreadConfig(thread.config_); });
  const bool configured = thread.failure_.empty();
  thread.ready_.store(true, std::memory_order_release);
  thread.ready_.notify_all();
  if (configured) thread.fenced(thread.body_);
  thread.running_.store(false, std::memory_order_release);
  return nullptr;
}

template <class Work>
void RtThread::fenced(const Work& work) noexcept {
  try {
    work();
  } catch (const std::exception& e) {
    keepFailure(e.what()[0] == '\0' ? "exception without text" : e.what());
  } catch (...) {
    keepFailure("exception of unknown type");
  }
}

void RtThread::keepFailure(const char* why) noexcept {
  try {
    failure_ = why;
  } catch (const std::bad_alloc&) {
    failure_ = "no memory";  // short enough to take none
  }
}

bool setLibraryStackBytes(std::size_t bytes) noexcept {
  pthread_attr_t attributes;
  if (::pthread_attr_init(&attributes) != 0) return false;
  const bool set =
      ::pthread_attr_setstacksize(&attributes, bytes) == 0 && ::pthread_setattr_default_np(&attributes) == 0;
  ::pthread_attr_destroy(&attributes);
  return set;
}

}  // namespace fathom::rt
