#include "recon/topside/stages/pose_network.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fathom::topside {
namespace {

constexpr int kLines = 4, kPerLine = 20;
constexpr double kSpacing = 0.3;  // [m], along a line and between lines

// A lawn mower's path of a camera looking down, 2 m over a level floor.
std::vector<SE3> lawnMower() {
  std::vector<SE3> poses;
  for (int line = 0; line < kLines; ++line)
    for (int k = 0; k < kPerLine; ++k) {
      const bool back = line % 2 == 1;
      poses.push_back(SE3::fromEuler(0.01 * std::sin(0.7 * k), 0.01 * std::cos(0.5 * k), back ? 3.1 : 0.05,
                                     {kSpacing * (back ? kPerLine - 1 - k : k), kSpacing * line, 8}));
    }
  return poses;
}

// Dead reckoning of it with a compass that deviates by up to `deviation` with the heading.
std::vector<SE3> reckon(const std::vector<SE3>& truth, double deviation) {
  std::vector<SE3> out{truth.front()};
  for (std::size_t k = 1; k < truth.size(); ++k) {
    const SE3 step = truth[k - 1].inverse() * truth[k];
    const double yaw = truth[k].euler().z();
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(deviation * std::cos(yaw), Eigen::Vector3d::UnitZ()));
    const Eigen::Vector3d way = turn * (truth[k - 1].rotation() * step.translation());
    out.emplace_back(turn * truth[k].rotation(), out.back().translation() + way);
  }
  return out;
}

class Links {
 public:
  explicit Links(const std::vector<SE3>& truth) : truth_(truth) {}

  CameraLink link(std::uint32_t a, std::uint32_t b) {
    Vector6d noise;
    for (int i = 0; i < 6; ++i) noise(i) = (i < 3 ? kPosition : kAngle) * normal_(random_);
    CameraLink l;
    l.a = a;
    l.b = b;
    l.T_a_b = truth_[a].inverse() * truth_[b] * SE3::exp(noise);
    Vector6d variance;
    variance << Eigen::Vector3d::Constant(kPosition * kPosition), Eigen::Vector3d::Constant(kAngle * kAngle);
    l.covariance = variance.asDiagonal();
    return l;
  }
  // Consecutive pairs, and each with its neighbour on the next line.
  std::vector<CameraLink> all() {
    std::vector<CameraLink> links;
    for (std::uint32_t k = 0; k + 1 < truth_.size(); ++k) links.push_back(link(k, k + 1));
    for (std::uint32_t line = 0; line + 1 < kLines; ++line)
      for (std::uint32_t k = 0; k < kPerLine; k += 3)
        links.push_back(link(line * kPerLine + k, (line + 2) * kPerLine - 1 - k));
    return links;
  }

 private:
  static constexpr double kPosition = 0.003, kAngle = 0.002;  // [m], [rad]
  const std::vector<SE3>& truth_;
  std::mt19937 random_{3};
  std::normal_distribution<double> normal_;
};

double rms(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += (a[k].translation() - b[k].translation()).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(PoseNetwork, LinksTakeOutTheDriftOfADeviatingCompass) {
  const std::vector<SE3> truth = lawnMower(), reckoned = reckon(truth, 0.05);
  std::vector<CameraLink> links = Links(truth).all();
  const std::vector<SE3> solved = solveNetwork(reckoned, links, {});
  std::printf("dead reckoning %.3f m, solved %.4f m\n", rms(reckoned, truth), rms(solved, truth));
  EXPECT_GT(rms(reckoned, truth), 0.15);
  EXPECT_LT(rms(solved, truth), 0.1 * rms(reckoned, truth));
  for (const CameraLink& link : links) EXPECT_TRUE(link.kept);
}

TEST(PoseNetwork, FalseClosuresAreTakenOutAndTheTrueOnesStay) {
  const std::vector<SE3> truth = lawnMower(), reckoned = reckon(truth, 0.05);
  std::vector<CameraLink> links = Links(truth).all();
  const std::vector<SE3> clean = solveNetwork(reckoned, links, {});
  const std::size_t honest = links.size();
  for (std::uint32_t k = 0; k < 4; ++k) {
    links.push_back(Links(truth).link(5 + k, 60 + 2 * k));
    links.back().T_a_b = links.back().T_a_b * SE3::fromEuler(0, 0, 0.1, {0.4, -0.3, 0.05});
  }
  const std::vector<SE3> solved = solveNetwork(reckoned, links, {});
  std::size_t lost = 0;
  for (std::size_t i = 0; i < honest; ++i) lost += links[i].kept ? 0 : 1;
  EXPECT_LE(lost, 1U);
  for (std::size_t i = honest; i < links.size(); ++i) EXPECT_FALSE(links[i].kept) << i;
  EXPECT_LT(rms(solved, clean), 0.005);
}

TEST(PoseNetwork, WithoutLinksDeadReckoningStays) {
  const std::vector<SE3> reckoned = reckon(lawnMower(), 0.05);
  std::vector<CameraLink> none;
  EXPECT_LT(rms(solveNetwork(reckoned, none, {}), reckoned), 1e-6);
  EXPECT_TRUE(solveNetwork({}, none, {}).empty());
}

}  // namespace
}  // namespace fathom::topside
