// A pair of images of a flat seafloor 2 m below two cameras: points and mesh.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"

int main() {
  using namespace fathom;
  constexpr int kWidth = 640, kHeight = 480;
  constexpr double kFocal = 400, kBaseline = 0.103, kDepth = 2;  // [px], [m], [m]
  const Camera camera{kWidth, kHeight, kFocal, kFocal, kWidth / 2.0, kHeight / 2.0};
  const StereoRig rig{camera, camera, SE3(Eigen::Quaterniond::Identity(), {-kBaseline, 0, 0})};

  // Waves of several directions and lengths on the seafloor, in grey levels; x and y in pixels of the left
  // image.
  const auto seafloor = [](double x, double y) {
    double level = 128;
    for (int k = 1; k <= 12; ++k)
      level += 12 * std::sin(0.1 * k * (x * std::cos(k * k) + y * std::sin(k * k)) + k);
    return static_cast<unsigned char>(level);
  };
  std::vector<unsigned char> left, right;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      left.push_back(seafloor(x, y));
      right.push_back(seafloor(x + kFocal * kBaseline / kDepth, y));
    }
  }
  const auto view = [](const std::vector<unsigned char>& pixels) {
    return ImageView{pixels.data(), kWidth, kHeight, kWidth, PixelFormat::kMono, 8};
  };

  stereo::SparseStereo matcher(rig, {});
  // Where the seafloor is expected, from the altitude: 10 % too far.
  const stereo::SeedPlane expected{Eigen::Vector3d::UnitZ(), 1.1 * kDepth};
  const Mesh mesh = stereo::toMesh(matcher.process(view(left), view(right), expected), {});
  double mean = 0, worst = 0;
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    mean += vertex.z() / static_cast<double>(mesh.vertices.size());
    worst = std::max(worst, std::abs(vertex.z() - kDepth));
  }
  std::printf("vertices %zu triangles %zu depth %.4f worst %.4f\n", mesh.vertices.size(),
              mesh.triangles.size(), mean, worst);
}
