#include "tests/onboard/faults/fault_case.hpp"

#include <array>
#include <cstring>
#include <random>

namespace fathom::test {
namespace {

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
  FaultCase made;
  made.part = part;
  made.process = process;
  made.fault = fault;
  return made;
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

}  // namespace fathom::test
