#include "tests/onboard/faults/damage.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <random>
#include <string_view>
#include <vector>

#include "realtime/onboard/mapper/mapper_channel.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using onboard::MapperUp;

std::vector<char> noise(std::size_t bytes, unsigned seed) {
  std::minstd_rand random(seed + 1);
  std::vector<char> made(bytes);
  for (char& byte : made) byte = static_cast<char>(random() >> 7U);
  return made;
}

// The part of a file from `from` to `to`, shares of its length.
void spoil(const fs::path& path, double from, double to, unsigned seed) {
  std::error_code error;
  const auto size = static_cast<double>(fs::file_size(path, error));
  if (error || size < 1) return;
  const int file = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  const std::vector<char> bytes = noise(static_cast<std::size_t>(size * (to - from)), seed);
  if (file < 0 || ::pwrite(file, bytes.data(), bytes.size(), static_cast<off_t>(size * from)) < 0) return;
  ::close(file);
}

void spoilFolder(const fs::path& folder, std::string_view suffix, double from, double to, unsigned seed) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_regular_file(error) && entry.path().filename().string().ends_with(suffix))
      spoil(entry.path(), from, to, seed++);
}

void spoilShared(pid_t mapper, std::size_t offset, std::size_t bytes, unsigned seed) {
  const fs::path path =
      fs::path("/proc") / std::to_string(mapper) / "fd" / std::to_string(onboard::kMapperUpFile);
  const int file = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  if (file < 0) return;
  void* memory = ::mmap(nullptr, sizeof(MapperUp), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  ::close(file);
  if (memory == MAP_FAILED) return;
  const std::vector<char> with = noise(bytes, seed);
  std::copy(with.begin(), with.end(), static_cast<char*>(memory) + offset);
  ::munmap(memory, sizeof(MapperUp));
}

fs::path newest(const fs::path& folder, std::string_view prefix) {
  fs::path found;
  fs::file_time_type when = fs::file_time_type::min();
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (!entry.path().filename().string().starts_with(prefix) || entry.last_write_time(error) < when)
      continue;
    when = entry.last_write_time(error);
    found = entry.path();
  }
  return found;
}

}  // namespace

bool replaysToOther(const FaultCase& fault) {
  return fault.is("stereo", PartFault::kCorrupt) || fault.is("map", PartFault::kCorrupt) ||
         fault.is("graph", PartFault::kCorrupt);
}

void damage(const FaultCase& fault, const fs::path& dive, pid_t mapper, unsigned seed) {
  const std::string_view part = fault.part;
  if (part == "supervisor") return spoilShared(mapper, 0, sizeof(MapperUp), seed);
  if (part == "publisher")
    return spoilShared(mapper, offsetof(MapperUp, state), sizeof(MapperUp) - offsetof(MapperUp, state), seed);
  if (part == "link") return spoilShared(mapper, offsetof(MapperUp, modem), sizeof(MapperUp::modem), seed);
  if (part == "stereo")
    spoilFolder(dive / "img", ".tif", 0.5, 1, seed);
  else if (part == "graph")
    spoilFolder(dive / "state", ".slots", 0, 1, seed);
  else if (part == "map")
    spoil(dive / "sensors.lcmlog", 0.5, 0.502, seed);
  else if (part == "output")
    spoilFolder(dive / "onboard.tmp", "", 0.2, 0.4, seed);
  else if (part == "checkpoints")
    spoil(newest(dive / "state", "checkpoint"), 0.3, 0.6, seed);
  else
    return;
  ::kill(mapper, SIGKILL);
}

}  // namespace fathom::test
