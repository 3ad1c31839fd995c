#include <algorithm>
#include <cmath>

#include "tests/bench/fusion_peer/open3d_peer.hpp"

namespace fathom::fusion {

DepthImage drawDepth(const Mesh& mesh, const SE3& T_nav_cam, const Camera& camera, double factor) {
  DepthImage out;
  out.camera = camera.scaled(factor);
  out.camera.k1 = out.camera.k2 = out.camera.p1 = out.camera.p2 = out.camera.k3 = 0;
  out.T_nav_cam = T_nav_cam;
  const int width = out.camera.width, height = out.camera.height;
  out.depth.assign(static_cast<std::size_t>(width * height), 0.0F);
  out.rgb.assign(out.depth.size() * 3, 0);
  const SE3 T_cam_nav = T_nav_cam.inverse();
  std::vector<Eigen::Vector3d> pixel;  // (column, row, 1 / depth)
  for (const auto& v : mesh.vertices) {
    const Eigen::Vector3d p = T_cam_nav * v.cast<double>();
    pixel.emplace_back(out.camera.fx * p.x() / p.z() + out.camera.cx,
                       out.camera.fy * p.y() / p.z() + out.camera.cy, 1 / p.z());
  }
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3d &a = pixel[t[0]], &b = pixel[t[1]], &c = pixel[t[2]];
    const auto cross = [](const auto& p, const auto& q, double x, double y) {
      return (q.x() - p.x()) * (y - p.y()) - (q.y() - p.y()) * (x - p.x());
    };
    const double area = cross(a, b, c.x(), c.y());
    if (area == 0) continue;
    const auto clampTo = [](double x, int end) { return std::clamp(static_cast<int>(x), 0, end - 1); };
    for (int y = clampTo(std::floor(std::min({a.y(), b.y(), c.y()})), height);
         y <= clampTo(std::ceil(std::max({a.y(), b.y(), c.y()})), height); ++y) {
      for (int x = clampTo(std::floor(std::min({a.x(), b.x(), c.x()})), width);
           x <= clampTo(std::ceil(std::max({a.x(), b.x(), c.x()})), width); ++x) {
        const double wa = cross(b, c, x, y) / area, wb = cross(c, a, x, y) / area, wc = 1 - wa - wb;
        if (wa < 0 || wb < 0 || wc < 0) continue;
        const auto at = static_cast<std::size_t>(y * width + x);
        const auto depth = static_cast<float>(1 / (wa * a.z() + wb * b.z() + wc * c.z()));
        if (out.depth[at] != 0 && out.depth[at] <= depth) continue;
        out.depth[at] = depth;
        for (std::size_t k = 0; k < 3; ++k)
          out.rgb[3 * at + k] = static_cast<std::uint8_t>(
              wa * mesh.colours[t[0]][k] + wb * mesh.colours[t[1]][k] + wc * mesh.colours[t[2]][k]);
      }
    }
  }
  return out;
}

}  // namespace fathom::fusion
