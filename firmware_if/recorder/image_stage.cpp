#include "firmware_if/recorder/image_stage.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr std::array<CameraSide, 2> kBothSides = {CameraSide::kLeft, CameraSide::kRight};
// A disk that takes longer for one image of each camera cannot also sync inputs within a second.
constexpr std::int64_t kMostImageTime_ns = 700 * kMillisecond_ns;

}  // namespace

ImageStage::ImageStage(const std::filesystem::path& folder, std::size_t most_waiting, ViewOf view_of,
                       Release release)
    : view_of_(std::move(view_of)),
      release_(std::move(release)),
      writer_(folder),
      lanes_{ImageLane(most_waiting), ImageLane(most_waiting)} {}

bool ImageStage::offer(const CameraFrame& frame) noexcept {
  if (laneOf(frame.side).offer(frame)) return true;
  release_(frame);
  return false;
}

void ImageStage::step(bool room) {
  const rt::RealClock clock;
  const std::int64_t start = clock.monotonicNs();
  const bool too_slow = time_ns_ > kMostImageTime_ns;
  if (room && waiting()) error_ = 0;
  std::array<std::optional<std::int64_t>, 2> written;  // times of what is to be committed
  for (const CameraSide side : kBothSides) {
    CameraFrame frame;
    if (!laneOf(side).take(frame)) continue;
    if (room && !too_slow && write(frame)) {
      written[static_cast<std::size_t>(side)] = frame.utc_ns;
    } else {
      ++(room && too_slow ? counters_.dropped_slow : counters_.dropped_disk);
      if (room && too_slow) time_ns_ -= time_ns_ / 4;  // tried again when some were left out
      laneOf(side).settle(frame.utc_ns, false);
    }
    release_(frame);
  }
  if (!written[0] && !written[1]) return;
  const bool good = writer_.commit();
  if (!good) ++counters_.failures;
  if (!good) error_ = writer_.error();
  for (const CameraSide side : kBothSides) {
    const auto utc_ns = written[static_cast<std::size_t>(side)];
    if (!utc_ns) continue;
    ++(good ? counters_.written : counters_.dropped_disk);
    if (laneOf(side).settle(*utc_ns, good)) ++counters_.without_input;
  }
  time_ns_ = clock.monotonicNs() - start;
}

bool ImageStage::write(const CameraFrame& frame) {
  const ImageView view = view_of_(frame);
  const bool good = !view.empty() && writer_.write(imageFileName(frame.utc_ns, frame.side), view);
  if (good) return true;
  ++counters_.failures;
  if (!view.empty()) error_ = writer_.error();
  return false;
}

void ImageStage::named(CameraSide side, std::int64_t utc_ns) noexcept {
  counters_.without_input += laneOf(side).forget(utc_ns);
}

std::size_t ImageStage::highWater() const noexcept {
  return std::max(lanes_[0].highWater(), lanes_[1].highWater());
}

}  // namespace fathom::io
