#include "tests/monitor/storm/sea.hpp"

#include <cmath>

namespace fathom::test {

void Sea::send(std::int64_t left_ns, std::span<const std::uint8_t> frame) {
  // Gilbert: the loss's share of the time is spent fading, `burst` frames at a time.
  const double out = 1 / weather_.burst, in = out * weather_.loss / std::max(1 - weather_.loss, 0.01);
  fading_ = draw() < (fading_ ? 1 - out : in);
  if (fading_ && weather_.loss > 0) return;
  const int copies = draw() < weather_.doubled ? 2 : 1;
  for (int k = 0; k < copies; ++k) {
    std::vector<std::uint8_t> bytes(frame.begin(), frame.end());
    if (draw() < weather_.damaged)
      bytes[random_() % bytes.size()] ^= static_cast<std::uint8_t>(1 + random_() % 255);
    double delay_s = weather_.sound_s;
    if (draw() < weather_.late) delay_s += draw() * weather_.late_s;
    under_way_.emplace(left_ns + std::llround(delay_s * 1e9), std::move(bytes));
  }
}

void Sea::receive(std::int64_t now_ns, const std::function<void(std::span<const std::uint8_t>)>& take) {
  while (!under_way_.empty() && under_way_.begin()->first <= now_ns) {
    const std::vector<std::uint8_t> bytes = std::move(under_way_.begin()->second);
    under_way_.erase(under_way_.begin());
    take(bytes);
  }
}

}  // namespace fathom::test
