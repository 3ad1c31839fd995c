#include "tests/bench/growth/mission_part.hpp"

#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission.hpp"
#include "firmware_if/log/log_events.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::growth {
namespace {

namespace fs = std::filesystem;

struct Image {
  std::int64_t utc_ns = 0;
  std::string stem;  // of the file's name
  CameraSide side = CameraSide::kLeft;
  fs::path file;
};

// By time.
std::vector<Image> imagesOf(const fs::path& mission) {
  const io::MissionPaths paths(mission);
  std::vector<Image> images;
  for (const fs::path& folder : {paths.images(), paths.features()}) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
      const std::string stem = entry.path().stem().string();
      if (const auto parsed = io::parseImageFileName(stem + ".tif"))
        images.push_back({parsed->utc_ns, stem, parsed->side, entry.path()});
    }
  }
  if (images.empty()) throw InputError(mission.string(), "", "holds no images and no features");
  std::sort(images.begin(), images.end(), [](const Image& a, const Image& b) {
    return std::tie(a.utc_ns, a.stem) < std::tie(b.utc_ns, b.stem);
  });
  return images;
}

bool names(std::span<const std::uint8_t> data, const std::vector<std::string>& stems) {
  return std::any_of(stems.begin(), stems.end(), [&](const std::string& stem) {
    return std::search(data.begin(), data.end(), stem.begin(), stem.end()) != data.end();
  });
}

}  // namespace

std::size_t pairsOf(const fs::path& mission) {
  const std::vector<Image> images = imagesOf(mission);
  return static_cast<std::size_t>(std::count_if(images.begin(), images.end(),
                                                [](const Image& i) { return i.side == CameraSide::kLeft; }));
}

void makePart(const fs::path& mission, std::size_t pairs, const fs::path& part) {
  const std::vector<Image> images = imagesOf(mission);
  std::vector<std::int64_t> left;
  for (const Image& image : images)
    if (image.side == CameraSide::kLeft) left.push_back(image.utc_ns);
  if (pairs < 1 || pairs > left.size())
    throw InputError(mission.string(), "",
                     "has " + std::to_string(left.size()) + " pairs, not " + std::to_string(pairs));
  const std::int64_t end =
      pairs == left.size() ? INT64_MAX : left[pairs - 1] + (left[pairs] - left[pairs - 1]) / 2;

  const fs::path whole = fs::canonical(mission);
  const io::MissionPaths from(whole), to(part);
  fs::remove_all(part);
  fs::create_directories(part);
  for (const fs::path& folder : {from.images(), from.features()})
    if (fs::exists(folder)) fs::create_directories(part / folder.filename());
  std::vector<std::string> left_out;  // the first few
  for (const Image& image : images) {
    constexpr std::size_t kFew = 4;  // the next pair, whichever of its images the log has first
    if (image.utc_ns < end)
      fs::create_symlink(fs::canonical(image.file),
                         part / image.file.parent_path().filename() / image.file.filename());
    else if (left_out.size() < kFew)
      left_out.push_back(image.stem);
  }
  for (const char* name : {"mission.toml", "stereo.calib", "truth"})
    if (fs::exists(whole / name)) fs::create_symlink(whole / name, part / name);
  if (!fs::exists(from.log())) return;
  io::LogEventReader reader(from.log());
  io::LogEventWriter writer(to.log());
  io::LogEvent event;
  while (reader.next(event)) {
    if (names(event.data, left_out)) break;
    writer.write(event.timestamp_us, event.channel, event.data);
  }
}

}  // namespace fathom::growth
