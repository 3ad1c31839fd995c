#include "sim/sea/light/water_light.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fathom::sim {
namespace {

// Attenuation's table.
constexpr float kStepsPerMetre = 64.0F;
constexpr float kLongestPath = 60.0F;  // [m]; beyond it the last entry holds

constexpr int kBeamSteps = 512;  // over the cosine, 0 to 1

// Backscatter's table: cells over the image, steps along the ray.
constexpr int kColumns = 25, kRows = 19;
constexpr int kRangeSteps = 97;
constexpr float kRangeStep = 0.125F;  // [m]
constexpr int kIntegrationSteps = 5;  // in each of these

struct TableCell {
  int index;
  float fraction;
};

TableCell tableCell(float value, int count) {
  const float v = std::clamp(value, 0.0F, static_cast<float>(count - 1));
  const int index = std::min(static_cast<int>(v), count - 2);
  return {index, v - static_cast<float>(index)};
}

}  // namespace

WaterAttenuation::WaterAttenuation(const WaterConfig& water)
    : table_(static_cast<std::size_t>(kLongestPath * kStepsPerMetre) + 2) {
  for (std::size_t i = 0; i < table_.size(); ++i)
    for (std::size_t c = 0; c < 3; ++c)
      table_[i][c] = static_cast<float>(std::exp(-(water.absorption_per_m[c] + water.scattering_per_m[c]) *
                                                 static_cast<double>(i) / kStepsPerMetre));
}

Radiance WaterAttenuation::operator()(float path_m) const {
  const TableCell cell = tableCell(path_m * kStepsPerMetre, static_cast<int>(table_.size()));
  const Radiance& a = table_[static_cast<std::size_t>(cell.index)];
  const Radiance& b = table_[static_cast<std::size_t>(cell.index) + 1];
  return {a[0] + cell.fraction * (b[0] - a[0]), a[1] + cell.fraction * (b[1] - a[1]),
          a[2] + cell.fraction * (b[2] - a[2])};
}

Beam::Beam(const StrobeConfig& strobe) : table_(kBeamSteps + 1) {
  const double power = std::log(0.5) / std::log(std::cos(strobe.half_angle_rad));
  for (std::size_t i = 0; i < table_.size(); ++i)
    table_[i] = static_cast<float>(strobe.intensity *
                                   std::pow(static_cast<double>(i) / static_cast<double>(kBeamSteps), power));
}

float Beam::operator()(float cos_off_axis) const {
  if (cos_off_axis <= 0) return 0;
  const TableCell cell = tableCell(cos_off_axis * kBeamSteps, kBeamSteps + 1);
  const float a = table_[static_cast<std::size_t>(cell.index)],
              b = table_[static_cast<std::size_t>(cell.index) + 1];
  return a + cell.fraction * (b - a);
}

Backscatter::Backscatter(const OpticsConfig& optics, const WaterAttenuation& attenuation,
                         const std::vector<Beam>& beams, const Camera& camera, const SE3& T_body_cam)
    : cells_per_px_x_(static_cast<float>(kColumns - 1) / static_cast<float>(std::max(1, camera.width - 1))),
      cells_per_px_y_(static_cast<float>(kRows - 1) / static_cast<float>(std::max(1, camera.height - 1))),
      table_(static_cast<std::size_t>(kColumns) * kRows * kRangeSteps) {
  const WaterConfig& water = optics.water;
  std::size_t index = 0;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const Eigen::Vector2d pixel(column * (camera.width - 1.0) / (kColumns - 1),
                                  row * (camera.height - 1.0) / (kRows - 1));
      const Eigen::Vector3d direction = T_body_cam.rotation() * camera.ray(pixel).normalized();
      std::array<double, 3> sum{};
      for (int step = 0; step < kRangeSteps; ++step) {
        for (std::size_t c = 0; c < 3; ++c) table_[index][c] = static_cast<float>(sum[c]);
        ++index;
        constexpr double kDt = static_cast<double>(kRangeStep) / kIntegrationSteps;
        for (int i = 0; i < kIntegrationSteps; ++i) {
          const double t = step * static_cast<double>(kRangeStep) + (i + 0.5) * kDt;
          const Eigen::Vector3d p = T_body_cam.translation() + t * direction;
          for (std::size_t s = 0; s < optics.strobes.size(); ++s) {
            const Eigen::Vector3d from = p - optics.strobes[s].position_body;
            const double d2 = from.squaredNorm(), d = std::sqrt(d2);
            constexpr double kNear = 1e-3;  // [m^2]: inside the strobe's glass
            if (d2 < kNear) continue;
            const double beam =
                beams[s](static_cast<float>(from.dot(optics.strobes[s].direction_body.normalized()) / d));
            const Radiance left = attenuation(static_cast<float>(d + t));
            for (std::size_t c = 0; c < 3; ++c)
              sum[c] += water.scattering_per_m[c] * water.backscatter_fraction / (2 * std::numbers::pi) *
                        beam / d2 * static_cast<double>(left[c]) * kDt;
          }
        }
      }
    }
  }
}

const Radiance& Backscatter::entry(int column, int row, int step) const {
  return table_[static_cast<std::size_t>((row * kColumns + column) * kRangeSteps + step)];
}

Radiance Backscatter::at(float x_px, float y_px, float range_m) const {
  const TableCell x = tableCell(x_px * cells_per_px_x_, kColumns),
                  y = tableCell(y_px * cells_per_px_y_, kRows),
                  r = tableCell(range_m / kRangeStep, kRangeSteps);
  Radiance sum{};
  for (int corner = 0; corner < 8; ++corner) {
    const int i = corner & 1, j = corner >> 1 & 1, k = corner >> 2;
    const float weight = (i ? x.fraction : 1 - x.fraction) * (j ? y.fraction : 1 - y.fraction) *
                         (k ? r.fraction : 1 - r.fraction);
    const Radiance& e = entry(x.index + i, y.index + j, r.index + k);
    for (std::size_t c = 0; c < 3; ++c) sum[c] += weight * e[c];
  }
  return sum;
}

}  // namespace fathom::sim
