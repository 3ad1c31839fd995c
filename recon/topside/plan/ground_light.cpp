#include "recon/topside/plan/ground_light.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::topside {
namespace {

constexpr float kSame = 0.01F;             // two vertices at the same place are no farther apart [m]
constexpr std::size_t kFewestPlaces = 15;  // of them, to compare two images
constexpr double kCoupleSigma = 0.03;      // of a couple's ratio, in logarithms: what the light model leaves
constexpr double kLeastSpread = 0.001;     // of gains
constexpr double kFull = 255;

// Neither dark, where noise is, nor clipped in any channel.
bool measured(const Rgb& colour) {
  constexpr std::uint8_t kDark = 15, kBright = 250;
  return std::all_of(colour.begin(), colour.end(),
                     [](std::uint8_t level) { return level > kDark && level < kBright; });
}

// How slopes answer to the lamps is known less well than what is sought.
bool steep(const Eigen::Vector3f& normal, const SE3& T_nav_cam) {
  constexpr double kSteepest = 0.87;  // cosine of the angle to the camera's axis
  const Eigen::Vector3d axis = T_nav_cam.rotation() * Eigen::Vector3d::UnitZ();
  return std::abs(axis.dot(normal.cast<double>())) < kSteepest;
}

std::uint64_t groundCellOf(int x, int y) {
  return static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32 | static_cast<std::uint32_t>(y);
}
int step(float metres) {
  return static_cast<int>(std::floor(metres / kSame));
}

// Of a couple in one colour: mean ratio y, before what the model took for the fall was taken out, and its
// derivatives x by power and fall a metre; both as FallCorrection::at() counts them. `usual`: depth [m].
struct CoupleFall {
  CoupleFall(const Couple& couple, std::size_t colour, const lighting::LightingModel& lighting, double usual)
      : count(static_cast<double>(couple.places.size())) {
    constexpr double kGross = 0.5;  // farther from a couple's median a ratio counts no more
    std::vector<double> ratios;
    for (const SamePlace& p : couple.places)
      ratios.push_back(static_cast<double>(p.log_ratio[static_cast<Eigen::Index>(colour)]));
    const double middle = median(ratios);
    for (std::size_t k = 0; k < ratios.size(); ++k) {
      double ratio = std::clamp(ratios[k], middle - kGross, middle + kGross);
      Eigen::Vector2d row(0, 0);
      for (std::size_t image = 0; image < 2; ++image) {
        const double side = image == 0 ? 1 : -1;
        const double range = static_cast<double>(couple.places[k].range[image]),
                     level = usual * range / static_cast<double>(couple.places[k].depth[image]);
        row += side * Eigen::Vector2d(std::log(range / level), level - range);
        ratio += side * (lighting.logFall(colour, range) - lighting.logFall(colour, level));
      }
      x += row / count, y += ratio / count;
    }
  }
  double count, y = 0;
  Eigen::Vector2d x = Eigen::Vector2d::Zero();
};

// What images of different ranges say by themselves: ground that is alike everywhere shows the fall.
void addTrend(std::size_t colour, const lighting::LightingModel& lighting, Eigen::Matrix2d& normal,
              Eigen::Vector2d& right) {
  constexpr double kAlbedo = 0.5;  // by which ground differs between classes of range, in logarithms
  double weight = 0, y = 0;
  Eigen::Vector2d x = Eigen::Vector2d::Zero(), xy = Eigen::Vector2d::Zero();
  Eigen::Matrix2d xx = Eigen::Matrix2d::Zero();
  for (int b = 0; b < lighting::RangeBins::kKnown; ++b) {
    const double w = lighting.seen(b) / (lighting.seen(b) + 1) / (kAlbedo * kAlbedo);
    const double range = lighting::RangeBins::middle(b), fall = lighting.logFall(colour, range);
    const Eigen::Vector2d row(std::log(range), -range);
    weight += w, y += w * fall, x += w * row, xy += w * fall * row, xx += w * row * row.transpose();
  }
  if (!(weight > 0) || lighting.used() != lighting::LightingKind::kRangeDependent) return;
  normal += xx - x * x.transpose() / weight;
  right += xy - x * y / weight;
}

// A pose that changes a little shall change no other images' colours: laws are known in steps.
constexpr double kLawStep = 0.02, kShareStep = 0.1;
double inSteps(double value, double step_size) {
  return step_size * std::round(value / step_size);
}

struct Fall {
  Eigen::Vector2d law;         // power, fall a metre
  Eigen::Matrix2d covariance;  // of these
};
Fall fallOf(const std::vector<CoupleFall>& couples, std::size_t colour,
            const lighting::LightingModel& lighting) {
  // A lamp beside the camera; there and back. Red is taken by water itself, 0.35 of it a metre (Pope & Fry
  // 1997), green and blue by what is in it: Jerlov's waters I to 3C (Solonenko & Mobley 2015).
  constexpr double kPower = -2, kPowerSigma = 0.3, kPerMetreSigma = 0.25;
  constexpr double kPerMetre[3] = {0.7, 0.3, 0.3};
  constexpr double kPlaceSigma = 0.1;  // of a place's ratio, in logarithms
  constexpr double kAlike = 10;        // neighbouring places that err alike, and couples
  constexpr double kLeastBetween = 0.01;
  constexpr int kRounds = 4;
  const Eigen::Vector2d prior(kPower, kPerMetre[colour]);
  const Eigen::Vector2d certain(1 / (kPowerSigma * kPowerSigma), 1 / (kPerMetreSigma * kPerMetreSigma));
  Fall fall{prior, {}};
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> rests;
    for (const CoupleFall& m : couples) rests.push_back(std::abs(m.y - m.x.dot(fall.law)));
    const double between = std::max(kLeastBetween, kMadToSigma * median(rests));
    Eigen::Matrix2d normal = certain.asDiagonal();
    Eigen::Vector2d right = certain.cwiseProduct(prior);
    addTrend(colour, lighting, normal, right);
    for (const CoupleFall& m : couples) {
      const double variance = kAlike * (between * between + kPlaceSigma * kPlaceSigma / m.count);
      normal += m.x * m.x.transpose() / variance;
      right += m.x * m.y / variance;
    }
    fall.covariance = normal.inverse();
    fall.law = fall.covariance * right;
  }
  return fall;
}

// Of a correction, what is beyond its own doubt (James and Stein 1961, for all classes of range together):
// where ground is alike everywhere what was learnt is better than any law.
double shareOf(const std::array<Fall, 3>& falls, const lighting::FallCorrection& correction,
               const lighting::LightingModel& lighting, double usual) {
  constexpr double kDoubt = 4;  // variance of laws over what they claim: haze, and lamps that are no points
  double squares = 0, variances = 0;
  for (std::size_t c = 0; c < falls.size(); ++c)
    for (int b = 0; b < lighting::RangeBins::kKnown; ++b) {
      const double range = lighting::RangeBins::middle(b),
                   off = static_cast<double>(correction.log_light[c][static_cast<std::size_t>(b)]);
      const Eigen::Vector2d row(std::log(range / usual), usual - range);
      squares += lighting.seen(b) * off * off;
      variances += lighting.seen(b) * row.dot(falls[c].covariance * row);
    }
  return squares > 0 ? std::max(0.0, 1 - kDoubt * variances / squares) : 0;
}

}  // namespace

std::vector<SamePlace> samePlaces(const Mesh& a, const Mesh& b, const SE3& T_nav_a, const SE3& T_nav_b) {
  std::unordered_multimap<std::uint64_t, std::uint32_t> cells;
  for (std::uint32_t k = 0; k < b.vertices.size(); ++k)
    cells.emplace(groundCellOf(step(b.vertices[k].x()), step(b.vertices[k].y())), k);
  const SE3 T_a_nav = T_nav_a.inverse(), T_b_nav = T_nav_b.inverse();
  std::vector<SamePlace> places;
  for (std::size_t k = 0; k < a.vertices.size(); ++k) {
    const Eigen::Vector3f& p = a.vertices[k];
    float nearest = kSame;
    std::optional<std::uint32_t> found;
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy) {
        const auto [begin, end] = cells.equal_range(groundCellOf(step(p.x()) + dx, step(p.y()) + dy));
        for (auto i = begin; i != end; ++i) {
          const float distance = (b.vertices[i->second] - p).norm();
          if (distance >= nearest) continue;
          nearest = distance;
          found = i->second;
        }
      }
    if (!found) continue;
    const Rgb &one = a.colours[k], &other = b.colours[*found];
    if (!measured(one) || !measured(other)) continue;
    if (steep(a.normals[k], T_nav_a) || steep(b.normals[*found], T_nav_b)) continue;

    const Eigen::Vector3f in_a = (T_a_nav * p.cast<double>()).cast<float>(),
                          in_b = (T_b_nav * b.vertices[*found].cast<double>()).cast<float>();
    if (!(in_a.z() > 0) || !(in_b.z() > 0)) continue;
    SamePlace place{.range = {in_a.norm(), in_b.norm()}, .depth = {in_a.z(), in_b.z()}};
    for (std::size_t c = 0; c < 3; ++c)
      place.log_ratio[static_cast<Eigen::Index>(c)] =
          static_cast<float>(std::log(linearFromSrgb(one[c]) / linearFromSrgb(other[c])));
    places.push_back(place);
  }
  if (places.size() < kFewestPlaces) places.clear();
  return places;
}

GroundLight groundLight(const PreparedGroups& prepared, const lighting::LightingModel& lighting,
                        const std::vector<SE3>& T_nav_cam,
                        const std::vector<std::pair<std::uint32_t, std::uint32_t>>& joined) {
  const auto pairs = static_cast<std::uint32_t>(T_nav_cam.size());
  std::vector<Couple> couples;
  for (std::uint32_t k = 0; k + 1 < pairs; ++k) couples.push_back({k, k + 1, {}});
  for (const auto& [a, b] : joined) couples.push_back({a, b, {}});
  const auto placed = [&](std::uint32_t k) {
    Mesh mesh;
    if (prepared.facts()[k].has_mesh) mesh = prepared.mesh(k);
    transform(mesh, T_nav_cam[k]);
    if (mesh.colours.empty()) mesh.vertices.clear();
    if (mesh.normals.empty()) computeNormals(mesh);
    return mesh;
  };
  oneapi::tbb::parallel_for(std::size_t{0}, couples.size(), [&](std::size_t k) {
    const auto [a, b] = std::pair(couples[k].a, couples[k].b);
    couples[k].places = samePlaces(placed(a), placed(b), T_nav_cam[a], T_nav_cam[b]);
  });
  std::erase_if(couples, [](const Couple& couple) { return couple.places.empty(); });
  GroundLight light;
  if (const auto water = waterOf(couples, lighting)) {
    light.water = *water;
    light.fall = lighting.correctionTo(*water);
  }
  light.gains = gainsOf(pairs, couples, light.fall);
  return light;
}

std::optional<lighting::WaterLaw> waterOf(const std::vector<Couple>& couples,
                                          const lighting::LightingModel& lighting) {
  const double usual = lighting.usualRange();
  if (couples.empty() || !(usual > 0)) return std::nullopt;
  lighting::WaterLaw water{.colours = {}, .share = 1};
  std::array<Fall, 3> falls;
  for (std::size_t c = 0; c < falls.size(); ++c) {
    std::vector<CoupleFall> of_couples;
    for (const Couple& couple : couples) of_couples.emplace_back(couple, c, lighting, usual);
    falls[c] = fallOf(of_couples, c, lighting);
    water.colours[c] = {inSteps(falls[c].law.x(), kLawStep), inSteps(falls[c].law.y(), kLawStep)};
  }
  water.share = inSteps(shareOf(falls, lighting.correctionTo(water), lighting, usual), kShareStep);
  return water;
}

void relight(Mesh& mesh, double gain, const lighting::FallCorrection& fall) {
  for (std::size_t k = 0; k < mesh.colours.size(); ++k)
    for (std::size_t c = 0; c < 3; ++c) {
      const double over =
          gain * std::exp(static_cast<double>(fall.at(c, mesh.vertices[k].norm(), mesh.vertices[k].z())));
      const double light = std::min(1.0, linearFromSrgb(mesh.colours[k][c]) / over);
      mesh.colours[k][c] = static_cast<std::uint8_t>(std::lround(kFull * srgbFromLinear(light)));
    }
}

std::vector<float> gainsOf(std::size_t pairs, const std::vector<Couple>& couples,
                           const lighting::FallCorrection& fall) {
  const Eigen::Vector3f luminance(0.2126F, 0.7152F, 0.0722F);
  std::vector<double> log_ratios, sizes;
  for (const Couple& couple : couples) {
    std::vector<double> ratios;
    for (const SamePlace& place : couple.places) {
      Eigen::Vector3f ratio = place.log_ratio;
      for (std::size_t c = 0; c < 3; ++c)
        ratio[static_cast<Eigen::Index>(c)] -=
            fall.at(c, place.range[0], place.depth[0]) - fall.at(c, place.range[1], place.depth[1]);
      ratios.push_back(static_cast<double>(luminance.dot(ratio)));
    }
    log_ratios.push_back(median(ratios));
    sizes.push_back(std::abs(log_ratios.back()));
  }
  if (sizes.empty()) return std::vector<float>(pairs, 1.0F);
  // Gains spread as much as couples' ratios do beyond what the light model leaves: nothing, mostly.
  const double seen = kMadToSigma * median(sizes);
  const double spread =
      std::max(kLeastSpread, std::sqrt(std::max(0.0, (seen * seen - kCoupleSigma * kCoupleSigma) / 2)));
  const auto n = static_cast<Eigen::Index>(pairs);
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (int k = 0; k < n; ++k) entries.emplace_back(k, k, 1 / (spread * spread));
  constexpr double kWeight = 1 / (kCoupleSigma * kCoupleSigma);
  for (std::size_t k = 0; k < couples.size(); ++k) {
    const auto a = static_cast<int>(couples[k].a), b = static_cast<int>(couples[k].b);
    entries.emplace_back(a, a, kWeight);
    entries.emplace_back(b, b, kWeight);
    entries.emplace_back(a, b, -kWeight);
    entries.emplace_back(b, a, -kWeight);
    right(a) += kWeight * log_ratios[k];
    right(b) -= kWeight * log_ratios[k];
  }
  Eigen::SparseMatrix<double> normal(n, n);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::VectorXd gains =
      Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(normal).solve(right).array().exp();
  return {gains.data(), gains.data() + gains.size()};
}

}  // namespace fathom::topside
