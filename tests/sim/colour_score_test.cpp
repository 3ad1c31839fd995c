// How far colours are off, of what and where.
#include "sim/score/colour_score.hpp"

#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "sim/score/truth_surface.hpp"
#include "sim/sea/ground/texture_image.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/ground.hpp"

namespace fathom::sim {
namespace {

TEST(Ciede2000, IsThatOfThePublishedPairs) {
  struct Pair {
    Eigen::Vector3d a, b;
    double difference;
  };
  const Pair pairs[] = {{{50, 2.6772, -79.7751}, {50, 0, -82.7485}, 2.0425},
                        {{50, 3.1571, -77.2803}, {50, 0, -82.7485}, 2.8615},
                        {{50, 0, 0}, {50, -1, 2}, 2.3669},
                        {{50, 2.49, -0.001}, {50, -2.49, 0.0009}, 7.1792},
                        {{50, -0.001, 2.49}, {50, 0.0009, -2.49}, 4.8045},
                        {{50, 2.5, 0}, {73, 25, -18}, 27.1492},
                        {{60.2574, -34.0099, 36.2677}, {60.4626, -34.1751, 39.4387}, 1.2644},
                        {{90.8027, -2.0831, 1.4410}, {91.1528, -1.6435, 0.0447}, 1.4441},
                        {{2.0776, 0.0795, -1.1350}, {0.9033, -0.0636, -0.5514}, 0.9082}};
  for (const Pair& p : pairs) {
    EXPECT_NEAR(ciede2000(p.a, p.b), p.difference, 1e-4);
    EXPECT_NEAR(ciede2000(p.b, p.a), p.difference, 1e-4);
  }
  EXPECT_LT((labOf({1, 1, 1}) - Eigen::Vector3d(100, 0, 0)).norm(), 0.02);
  EXPECT_LT((labOf({1, 0, 0}) - Eigen::Vector3d(53.24, 80.09, 67.20)).norm(), 0.05);
}

const Camera kCamera{1360, 1024, 400, 400, 680, 512, 0, 0, 0, 0, 0};

SE3 lookingDown(const Eigen::Vector3d& from) {
  return {Eigen::Quaterniond::Identity(), from};
}

// A seafloor of two colours, as it is, through a filter, and with its north half tinted.
TEST(ColourScore, ForgivesOneWhiteBalanceAndNoOther) {
  Mesh mesh = test::syntheticSeafloor();
  const auto paint = [&](const Rgb& south, const Rgb& north) {
    mesh.colours.clear();
    for (const auto& v : mesh.vertices) mesh.colours.push_back(v.x() < 0 ? south : north);
    return mesh;
  };
  const TruthSurface truth(paint({180, 160, 130}, {90, 70, 60}));
  const auto score = [&](const Mesh& product) {
    return *scoreColours(colouredPoints(product), truth, SE3(), kCamera, {lookingDown({0, 0, 8})});
  };
  const ColourScore same = score(mesh);
  EXPECT_LT(same.p95, 0.01);
  EXPECT_GT(same.squares.size(), 10000U);
  const auto dimmed = [](const Rgb& c) {
    Rgb out;
    const double gains[] = {0.4, 0.6, 0.55};
    for (std::size_t i = 0; i < 3; ++i)
      out[i] = srgbFromLinear(gains[i] * static_cast<double>(linearFromSrgb(c[i])));
    return out;
  };
  const ColourScore filtered = score(paint(dimmed({180, 160, 130}), dimmed({90, 70, 60})));
  EXPECT_LT(filtered.p95, 0.7);  // bytes
  EXPECT_NEAR(filtered.gains.x(), 1 / 0.4, 0.05);
  const ColourScore tinted = score(paint({180, 160, 130}, {70, 80, 60}));
  EXPECT_GT(tinted.p95, 5);
  EXPECT_GT(tinted.chroma + tinted.median, 0);
  EXPECT_FALSE(scoreColours({}, truth, SE3(), kCamera, {}).has_value());
}

// Colours that are right in the middle of the image and a third too dark at its top and bottom.
TEST(ColourDetail, FindsErrorsByPlaceAndByColour) {
  Mesh mesh = test::syntheticSeafloor();
  for (const auto& v : mesh.vertices)
    mesh.colours.push_back(v.x() < 0 ? Rgb{190, 170, 130} : Rgb{60, 100, 60});
  const TruthSurface truth(mesh);
  const Mesh as_it_is = mesh;
  for (std::size_t k = 0; k < mesh.vertices.size(); ++k)
    if (std::abs(mesh.vertices[k].y()) > 1.6F)
      for (std::uint8_t& c : mesh.colours[k]) c = static_cast<std::uint8_t>(c * 4 / 5);
  const auto detail = [&](const Mesh& product) {
    const ColourScore score =
        *scoreColours(colouredPoints(product), truth, SE3(), kCamera, {lookingDown({0, 0, 3})});
    const test::TemporaryFolder folder;
    writeColourMap(folder.path() / "map.png", score);
    const cv::Mat page = cv::imread((folder.path() / "map.png").string());
    EXPECT_GT(page.cols, 3 * 180);
    EXPECT_GT(page.rows, 100);
    return colourDetail(score);
  };
  const auto medians = [](const std::string& text, const std::string& row) {
    std::istringstream line(text.substr(text.find(row) + row.size()));
    double bounds[4];
    std::array<double, 6> out{};
    for (double& b : bounds) line >> b;
    for (double& v : out) line >> v;
    return out;
  };
  const std::string off = detail(mesh);
  std::printf("%s", off.c_str());
  const auto height = medians(off, "height [1]");
  EXPECT_GT(height[0], height[2] + 3);
  EXPECT_GT(height[4], height[2] + 3);
  EXPECT_LT(medians(detail(as_it_is), "height [1]")[1], 0.1);
  EXPECT_NE(off.find("beige"), std::string::npos);
  EXPECT_NE(off.find("green"), std::string::npos);
  EXPECT_EQ(off.find("violet"), std::string::npos);
  EXPECT_STREQ(colourName({20, 0, 0}), "dark");
  EXPECT_STREQ(colourName({85, 2, 3}), "white");
  EXPECT_STREQ(colourName({50, 30, -35}), "violet");
}

}  // namespace
}  // namespace fathom::sim
