#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/pd0_builder.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

Pd0Ensemble ensembleIn(Pd0Frame frame, const Eigen::Vector4d& velocity) {
  Pd0Ensemble out;
  out.utc_ns = 1;
  out.frame = frame;
  out.beam_angle = M_PI / 6;
  out.heading_deg = 0;
  out.pitch_deg = 0;
  out.roll_deg = 0;
  out.bottom_track.emplace();
  for (std::size_t i = 0; i < 4; ++i) out.bottom_track->velocity[i] = velocity[static_cast<Eigen::Index>(i)];
  return out;
}

TEST(DvlSample, ShipVelocityBecomesTheVehiclesOwnInForwardStarboardDown) {
  // The bottom moves aft at 1.5 m/s, to port at 0.1 m/s and comes up at 0.2 m/s.
  const auto sample = toDvlSample(ensembleIn(Pd0Frame::kShip, {-0.1, -1.5, 0.2, 0}));
  ASSERT_TRUE(sample && sample->velocity);
  EXPECT_TRUE(sample->velocity->isApprox(Eigen::Vector3d(1.5, 0.1, 0.2), 1e-12));
}

TEST(DvlSample, BeamVelocitiesGiveTheVelocityThatTheyAreProjectionsOf) {
  // Each beam sees the bottom's velocity along itself, positive towards the transducer; beams 1 port, 2
  // starboard, 3 forward, 4 aft, 30 degrees from straight down.
  const Eigen::Vector3d own(1.4, -0.3, 0.25);  // forward, starboard, down
  const double s = std::sin(M_PI / 6);
  const double c = std::cos(M_PI / 6);
  const std::array<Eigen::Vector3d, 4> beam = {Eigen::Vector3d{0, -s, c}, {0, s, c}, {s, 0, c}, {-s, 0, c}};
  Eigen::Vector4d measured;
  for (Eigen::Index i = 0; i < 4; ++i) measured[i] = own.dot(beam[static_cast<std::size_t>(i)]);
  const auto sample = toDvlSample(ensembleIn(Pd0Frame::kBeam, measured));
  ASSERT_TRUE(sample && sample->velocity);
  EXPECT_TRUE(sample->velocity->isApprox(own, 1e-12)) << sample->velocity->transpose();
}

TEST(DvlSample, EarthVelocityIsTurnedBackByHeadingPitchAndRoll) {
  Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kEarth, {-1.0, 0.0, 0.0, 0});  // the vehicle goes east at 1 m/s
  ensemble.heading_deg = 90;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity->isApprox(Eigen::Vector3d(1, 0, 0), 1e-12));
  ensemble.heading_deg = 0;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity->isApprox(Eigen::Vector3d(0, 1, 0), 1e-12));
  // Nose up 30 degrees and level flight to the north: part of it points down in the vehicle's frame.
  ensemble = ensembleIn(Pd0Frame::kEarth, {0, -1.0, 0, 0});
  ensemble.pitch_deg = 30;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity->isApprox(
      Eigen::Vector3d(std::cos(M_PI / 6), 0, std::sin(M_PI / 6)), 1e-12));
}

TEST(DvlSample, AltitudeOverAFlatBottomIsExactAtAnyTilt) {
  // Ranges along the instrument's axis, from the geometry: slant = altitude / (direction . down), range =
  // slant cos a.
  const double altitude = 2.5;
  for (const double pitch : {-20.0, 0.0, 15.0}) {
    for (const double roll : {-10.0, 0.0, 12.0}) {
      Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kShip, {0, 0, 0, 0});
      ensemble.pitch_deg = pitch;
      ensemble.roll_deg = roll;
      const double r = degreesToRadians(roll);
      const double p = std::atan(std::tan(degreesToRadians(pitch)) * std::cos(r));
      const Eigen::Vector3d down(-std::sin(p), std::cos(p) * std::sin(r), std::cos(p) * std::cos(r));
      const double s = std::sin(M_PI / 6);
      const double c = std::cos(M_PI / 6);
      const std::array<Eigen::Vector3d, 4> beam = {
          Eigen::Vector3d{0, -s, c}, {0, s, c}, {s, 0, c}, {-s, 0, c}};
      for (std::size_t i = 0; i < 4; ++i) ensemble.bottom_track->range[i] = altitude / beam[i].dot(down) * c;
      EXPECT_NEAR(*toDvlSample(ensemble)->altitude, altitude, 1e-12) << pitch << " " << roll;
      ensemble.bottom_track->range[2].reset();  // one pair is enough
      EXPECT_NEAR(*toDvlSample(ensemble)->altitude, altitude, 1e-12);
      ensemble.bottom_track->range[0].reset();
      EXPECT_FALSE(toDvlSample(ensemble)->altitude);
    }
  }
}

TEST(DvlSample, AMissingComponentIsAMissingVelocityAndNeverZero) {
  Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kInstrument, {0, -1, 0, 0});
  ensemble.bottom_track->velocity[2].reset();
  EXPECT_FALSE(toDvlSample(ensemble)->velocity);
  ensemble.utc_ns.reset();
  EXPECT_FALSE(toDvlSample(ensemble));
}

TEST(DvlSample, AnUpLookingProfileHeadLeavesShipVelocityButNotThatOfItsOwnAxes) {
  Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kShip, {0, -1, 0, 0});
  ensemble.up_looking = true;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity);
  ensemble.frame = Pd0Frame::kInstrument;
  EXPECT_FALSE(toDvlSample(ensemble)->velocity);
}

TEST(DvlSample, OnARealDiveTheVelocityExplainsTheChangeOfAltitude) {
  FATHOM_REQUIRE_DATA("dvl/adcp.adc");
  std::ifstream in(test::dataFile("dvl/adcp.adc"), std::ios::binary);
  const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), {}};
  Pd0Decoder decoder;
  std::optional<Pd0Ensemble> last;
  double sum_squares = 0;
  double rate_squares = 0;
  double forward = 0;
  int pairs = 0;
  const auto downRate = [](const Pd0Ensemble& ensemble, const DvlSample& sample) {
    const double pitch = degreesToRadians(*ensemble.pitch_deg);
    return sample.velocity->z() * std::cos(pitch) - sample.velocity->x() * std::sin(pitch);
  };
  decoder.feed(bytes, [&](const Pd0Ensemble& ensemble) {
    const auto a = last ? toDvlSample(*last) : std::nullopt;
    const auto b = toDvlSample(ensemble);
    if (a && b && a->velocity && b->velocity && a->altitude && b->altitude) {
      const double dt = static_cast<double>(b->utc_ns - a->utc_ns) * 1e-9;
      const double rate = (*b->altitude - *a->altitude) / dt;
      if (dt > 0 && dt < 5 && std::abs(rate) < 1) {
        sum_squares += std::pow(rate + (downRate(*last, *a) + downRate(ensemble, *b)) / 2, 2);
        rate_squares += rate * rate;
        forward += b->velocity->x();
        ++pairs;
      }
    }
    last = ensemble;
  });
  ASSERT_GT(pairs, 3000);
  // The rest is the seafloor's own relief. With a wrong sign, axis or levelling it exceeds the rate itself.
  EXPECT_LT(std::sqrt(sum_squares / pairs), 0.5 * std::sqrt(rate_squares / pairs));
  EXPECT_GT(forward / pairs, 1.0) << "the vehicle flies forward";
}

}  // namespace
}  // namespace fathom::io
