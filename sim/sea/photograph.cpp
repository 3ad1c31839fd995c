#include "sim/sea/photograph.hpp"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <mutex>
#include <thread>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"

namespace fathom::sim {

void photograph(const Renderer& renderer, const SE3& T_nav_body, double time_s, CameraSide side,
                std::uint64_t noise_seed, const std::filesystem::path& file,
                const PhotoConditions& conditions) {
  const int width = renderer.width(side), height = renderer.height(side);
  std::vector<std::uint16_t> pixels(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  renderer.render(T_nav_body, time_s, side, noise_seed, pixels.data(), conditions);
  ImageView view{
      pixels.data(),         width,          height, static_cast<std::size_t>(width) * sizeof(std::uint16_t),
      renderer.format(side), renderer.bits()};
  std::vector<std::uint8_t> bytes;
  if (renderer.bits() == 8) {
    bytes.assign(pixels.begin(), pixels.end());
    view.data = bytes.data();
    view.stride = static_cast<std::size_t>(width);
  }
  io::writeImage(file, view);
}

void withThreads(int threads, const std::function<void()>& work) {
  const int count =
      threads > 0 ? threads : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(count));
  tbb::task_arena(count).execute(work);
}

void forEachPair(std::size_t count, const std::function<void(std::size_t done, std::size_t total)>& progress,
                 const std::function<void(std::size_t)>& make) {
  std::mutex mutex;
  std::size_t done = 0;
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    // Isolated, so that a thread that waits inside one image does not begin another.
    tbb::this_task_arena::isolate([&] { make(i); });
    const std::lock_guard lock(mutex);
    ++done;
    if (progress) progress(done, count);
  });
}

}  // namespace fathom::sim
