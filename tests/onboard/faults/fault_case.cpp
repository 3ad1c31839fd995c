#include "tests/onboard/faults/fault_case.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <random>
#include <string_view>
#include <vector>

#include "realtime/onboard/mapper/mapper_channel.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using onboard::MapperUp;

constexpr std::array<const char*, 4> kPaths = {"sensors.lcmlog", "img/", "onboard.tmp", "state/"};
constexpr std::array<DiskFault, 5> kDiskFaults = {DiskFault::kNoSpace, DiskFault::kReadOnly,
                                                  DiskFault::kInputOutput, DiskFault::kStall,
                                                  DiskFault::kShortWrite};
constexpr std::array<const char*, 6> kDiskNames = {"-", "ENOSPC", "EROFS", "EIO", "stalls", "short write"};
constexpr int kDisk = static_cast<int>(kPaths.size() * kDiskFaults.size());

// "mapper": the whole process, by signals. The others have fault points of these names.
constexpr std::array<const char*, 8> kVehicleParts = {"navigation",   "recorder", "samples",   "left camera",
                                                      "right camera", "modem",    "publisher", "supervisor"};
constexpr std::array<const char*, 7> kMapperParts = {"mapper", "stereo", "graph",      "map",
                                                     "link",   "output", "checkpoints"};
constexpr std::array<const char*, 9> kFaultNames = {"-",      "throws",    "aborts", "segmentation fault",
                                                    "killed", "hangs 1 s", "hangs",  "10 times slower",
                                                    "corrupt"};

FaultCase partFault(const char* part, PartOf process, PartFault fault) {
  return FaultCase{.part = part, .process = process, .fault = fault, .disk = {}};
}

// Those of the whole mapper first.
std::vector<FaultCase> allPartFaults() {
  std::vector<FaultCase> all;
  for (const PartFault fault : {PartFault::kAbort, PartFault::kSegmentation, PartFault::kKill,
                                PartFault::kHangShort, PartFault::kHang, PartFault::kSlow})
    all.push_back(partFault(kMapperParts[0], PartOf::kMapper, fault));
  for (std::size_t fault = 1; fault < kFaultNames.size(); ++fault) {
    for (const char* part : kVehicleParts)
      all.push_back(partFault(part, PartOf::kVehicle, static_cast<PartFault>(fault)));
    for (std::size_t i = 1; i < kMapperParts.size(); ++i)
      all.push_back(partFault(kMapperParts[i], PartOf::kMapper, static_cast<PartFault>(fault)));
  }
  return all;
}
constexpr int kOfMapper = 6;

BadDisk::Order diskFault(int number) {
  BadDisk::Order order;
  order.path = kPaths[static_cast<std::size_t>(number) % kPaths.size()];
  order.fault = kDiskFaults[static_cast<std::size_t>(number) / kPaths.size()];
  order.for_ms = kFaultFor_ms;
  if (order.fault == DiskFault::kStall) {
    order.stall_ms = static_cast<std::uint32_t>(kFaultFor_ms);
    order.times = 1;
  }
  return order;
}

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

std::string FaultCase::name() const {
  std::string text;
  if (fault != PartFault::kNone)
    text = std::string(part) + " " + kFaultNames[static_cast<std::size_t>(fault)];
  if (disk.fault != DiskFault::kNone)
    text += (text.empty() ? "" : ", ") + disk.path + " " + kDiskNames[static_cast<std::size_t>(disk.fault)];
  return text;
}

bool FaultCase::endsVehicle() const {
  if (process != PartOf::kVehicle) return false;
  return fault == PartFault::kAbort || fault == PartFault::kSegmentation || fault == PartFault::kKill ||
         hangs() || is("navigation", PartFault::kThrow);
}

bool FaultCase::is(const char* a_part, PartFault a_fault) const {
  return fault == a_fault && std::strcmp(part, a_part) == 0;
}

int systematicCases() {
  const int parts = static_cast<int>(allPartFaults().size());
  return parts + kDisk + kOfMapper * kDisk + (parts - kOfMapper);
}

FaultCase faultCase(unsigned seed, int number) {
  const std::vector<FaultCase> faults = allPartFaults();
  const int parts = static_cast<int>(faults.size());
  std::mt19937_64 random(seed * 1'000'003ULL + static_cast<unsigned>(number));
  const auto below = [&](int end) { return static_cast<int>(random() % static_cast<unsigned>(end)); };
  const double after_s = std::uniform_real_distribution<double>(0, 0.5)(random),
               apart_s = std::uniform_real_distribution<double>(0, 0.6)(random);
  FaultCase made;
  const auto part = [&](int which) { made = faults.at(static_cast<std::size_t>(which)); };
  if (number >= systematicCases()) {
    part(below(parts));
    if (below(4) > 0) made.disk = diskFault(below(kDisk));
  } else if (number < parts) {
    part(number);
  } else if ((number -= parts) < kDisk) {
    made.disk = diskFault(number);
  } else if ((number -= kDisk) < kOfMapper * kDisk) {
    part(number / kDisk);
    made.disk = diskFault(number % kDisk);
  } else {
    part(kOfMapper + number - kOfMapper * kDisk);
    made.disk = diskFault(below(kDisk));
  }
  made.after_s = after_s;
  made.apart_s = apart_s;
  return made;
}

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
