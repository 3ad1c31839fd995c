#include "realtime/kernel/memory/process_memory.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <charconv>
#include <cstdio>
#include <cstring>
#include <string_view>

namespace fathom::rt {
namespace {

constexpr std::size_t kStatusBytes = 4096;  // /proc/self/status has some 1.5 kB

// The number behind "Key:" in a text of lines "Key:   123 kB", in bytes; 0 where it is missing.
std::size_t kilobytes(std::string_view text, std::string_view key) noexcept {
  std::size_t at = text.find(key);
  while (at != std::string_view::npos && at != 0 && text[at - 1] != '\n') at = text.find(key, at + 1);
  if (at == std::string_view::npos) return 0;
  at = text.find_first_of("0123456789", at + key.size());
  if (at == std::string_view::npos) return 0;
  std::size_t value = 0;
  std::from_chars(text.data() + at, text.data() + text.size(), value);
  return value * 1024;
}

}  // namespace

ProcessMemory::ProcessMemory() noexcept : status_(::open("/proc/self/status", O_RDONLY | O_CLOEXEC)) {}
ProcessMemory::~ProcessMemory() {
  if (status_ >= 0) ::close(status_);
}

bool ProcessMemory::read(ProcessFigures& figures) noexcept {
  char buffer[kStatusBytes];
  const ssize_t bytes = status_ < 0 ? -1 : ::pread(status_, buffer, sizeof buffer, 0);
  if (bytes <= 0) return false;
  const std::string_view text(buffer, static_cast<std::size_t>(bytes));
  figures.resident = kilobytes(text, "VmRSS:");
  figures.resident_private = kilobytes(text, "RssAnon:");
  figures.resident_files = kilobytes(text, "RssFile:");
  figures.resident_shared = kilobytes(text, "RssShmem:");
  figures.highest_resident = kilobytes(text, "VmHWM:");
  figures.locked = kilobytes(text, "VmLck:");
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  figures.minor_faults = static_cast<std::uint64_t>(usage.ru_minflt);
  figures.major_faults = static_cast<std::uint64_t>(usage.ru_majflt);
  return true;
}

std::size_t exactResidentBytes() noexcept {
  const int file = ::open("/proc/self/smaps_rollup", O_RDONLY | O_CLOEXEC);
  if (file < 0) return 0;
  char buffer[kStatusBytes];
  const ssize_t bytes = ::pread(file, buffer, sizeof buffer, 0);
  ::close(file);
  return bytes <= 0 ? 0 : kilobytes({buffer, static_cast<std::size_t>(bytes)}, "Rss:");
}

std::size_t mappedPrivateBytes() noexcept {
  std::FILE* maps = std::fopen("/proc/self/maps", "re");
  if (maps == nullptr) return 0;
  std::size_t total = 0;
  char line[512];
  while (std::fgets(line, sizeof line, maps) != nullptr) {
    unsigned long begin = 0, end = 0, inode = 0;
    char rights[5] = {};
    if (std::sscanf(line, "%lx-%lx %4s %*x %*s %lu", &begin, &end, rights, &inode) == 4 && inode == 0 &&
        std::strcmp(rights, "rw-p") == 0)
      total += end - begin;
  }
  std::fclose(maps);
  return total;
}

std::size_t mappedFileBytes() noexcept {
  std::FILE* maps = std::fopen("/proc/self/maps", "re");
  if (maps == nullptr) return 0;
  std::size_t total = 0;
  char line[512];
  while (std::fgets(line, sizeof line, maps) != nullptr) {
    unsigned long begin = 0, end = 0, inode = 0;
    char rights[5] = {};
    // A page without any right is never resident; memory without a name that processes share is a pool's.
    if (std::sscanf(line, "%lx-%lx %4s %*x %*s %lu", &begin, &end, rights, &inode) == 4 && inode != 0 &&
        rights[0] == 'r' && rights[3] == 'p' &&
        !(std::strcmp(rights, "r--p") == 0 && end - begin >= kBulkDataBytes))
      total += end - begin;
  }
  std::fclose(maps);
  return total;
}

std::size_t privateFileBytes() noexcept {
  std::FILE* maps = std::fopen("/proc/self/smaps", "re");
  if (maps == nullptr) return 0;
  std::size_t total = 0;
  bool of_file = false;
  char line[512];
  while (std::fgets(line, sizeof line, maps) != nullptr) {
    unsigned long begin = 0, end = 0, inode = 0, anonymous = 0;
    char rights[5] = {};
    if (std::sscanf(line, "%lx-%lx %4s %*x %*s %lu", &begin, &end, rights, &inode) == 4) {
      const bool writable = std::strcmp(rights, "rw-p") == 0;
      of_file = inode != 0 && rights[3] == 'p' && !writable;
      if (inode != 0 && writable) total += end - begin;
    } else if (of_file && std::sscanf(line, "Anonymous: %lu kB", &anonymous) == 1) {
      total += anonymous * 1024;
    }
  }
  std::fclose(maps);
  return total;
}

}  // namespace fathom::rt
