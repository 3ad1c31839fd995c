#include "sim/sea/photograph.hpp"

#include <vector>

#include "firmware_if/files/images/image_file.hpp"

namespace fathom::sim {

void photograph(const Renderer& renderer, const SE3& T_nav_body, double time_s, CameraSide side,
                std::uint64_t noise_seed, const std::filesystem::path& file, const Moment& moment) {
  const int width = renderer.width(side), height = renderer.height(side);
  std::vector<std::uint16_t> pixels(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  renderer.render(T_nav_body, time_s, side, noise_seed, pixels.data(), moment);
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

}  // namespace fathom::sim
