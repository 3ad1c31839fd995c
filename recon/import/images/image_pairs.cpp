#include "recon/import/images/image_pairs.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <variant>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/import/images/stereo_files.hpp"
#include "recon/navigation/dead_reckoning/camera_clock.hpp"

namespace fathom::topside {
namespace {

struct TimedName {
  std::int64_t utc_ns;
  std::string name;
  double exposure_s = 0;
  auto operator<=>(const TimedName&) const = default;
};

struct Images {
  std::vector<TimedName> left, right;

  void add(CameraSide side, std::int64_t utc_ns, const std::string& name, double exposure_s = 0) {
    (side == CameraSide::kLeft ? left : right).push_back({utc_ns, name, exposure_s});
  }
};

Images fromLog(const io::MissionPaths& paths) {
  Images images;
  nav::CameraClock left, right;
  io::SensorLogReader reader(paths.root);
  while (const auto entry = reader.next())
    if (const auto* event = std::get_if<ImageEvent>(&entry->sample)) {
      nav::CameraClock& clock = event->side == CameraSide::kLeft ? left : right;
      images.add(event->side, clock.utcNs(event->utc_ns, entry->arrival_utc_ns), event->file_name,
                 event->exposure_s);
    }
  return images;
}

Images fromFileNames(const io::MissionPaths& paths, bool features_only) {
  Images images;
  std::error_code error;
  if (features_only) {
    // One file a pair, named after its left image.
    for (const auto& entry : std::filesystem::directory_iterator(paths.features(), error)) {
      if (entry.path().extension() != ".feat") continue;
      const std::string left = entry.path().stem().string() + ".tif";
      const auto parsed = io::parseImageFileName(left);
      if (!parsed || parsed->side != CameraSide::kLeft) continue;
      images.add(CameraSide::kLeft, parsed->utc_ns, left);
      images.add(CameraSide::kRight, parsed->utc_ns, io::imageFileName(parsed->utc_ns, CameraSide::kRight));
    }
    return images;
  }
  for (const auto& entry : std::filesystem::directory_iterator(paths.images(), error)) {
    const std::string name = entry.path().filename().string();
    if (const auto parsed = io::parseImageFileName(name)) images.add(parsed->side, parsed->utc_ns, name);
  }
  return images;
}

void prepare(std::vector<TimedName>& images, double offset_s) {
  for (TimedName& image : images) image.utc_ns += rt::nanoseconds(offset_s);
  std::sort(images.begin(), images.end());
  // One image is one event, however often the log says it.
  images.erase(std::unique(images.begin(), images.end(),
                           [](const TimedName& a, const TimedName& b) { return a.name == b.name; }),
               images.end());
}

}  // namespace

PairList listPairs(const io::MissionPaths& paths, const io::MissionConfig& mission, double tolerance) {
  PairList list;
  list.features_only = io::isFeatureMission(paths);
  Images images = fromLog(paths);
  if (images.left.empty() && images.right.empty()) {
    images = fromFileNames(paths, list.features_only);
    list.from_file_names = true;
  }
  prepare(images.left, mission.time_offsets.left_camera);
  prepare(images.right, mission.time_offsets.right_camera);

  const auto times = [](const std::vector<TimedName>& names) {
    std::vector<std::int64_t> utc_ns;
    for (const TimedName& name : names) utc_ns.push_back(name.utc_ns);
    return utc_ns;
  };
  const auto partners =
      partnersByTime(times(images.left), times(images.right), tolerance, mission.start_utc_ns);
  for (std::size_t k = 0; k < partners.size(); ++k) {
    if (!partners[k]) {
      ++list.left_alone;
      continue;
    }
    const TimedName &left = images.left[k], &right = images.right[*partners[k]];
    list.pairs.push_back({.utc_ns = left.utc_ns,
                          .left = left.name,
                          .right = right.name,
                          .exposures_s = {left.exposure_s, right.exposure_s}});
  }
  list.right_alone = images.right.size() - list.pairs.size();
  if (list.pairs.empty())
    throw InputError(paths.root.string(), list.features_only ? "features" : "img",
                     "no stereo pair: " + std::to_string(images.left.size()) + " left and " +
                         std::to_string(images.right.size()) +
                         " right images; check the cameras' names and clocks");
  return list;
}

}  // namespace fathom::topside
