#include "recon/geometry/tide.hpp"

#include <gmock/gmock.h>

#include "realtime/kernel/input_error.hpp"

namespace fathom {
namespace {

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;  // [ns]

TEST(Tide, IsTheSinusoidOfTheMissionFromItsStartOn) {
  const auto tide = readTide("sinusoid amplitude_m=1.5 period_s=1200 phase_rad=0.5", kStart);
  ASSERT_TRUE(tide);
  EXPECT_NEAR(tide->heightAt(kStart), 1.5 * std::sin(0.5), 1e-9);
  EXPECT_NEAR(tide->heightAt(kStart + 300'000'000'000), 1.5 * std::cos(0.5), 1e-6);
}

TEST(Tide, AModelThatIsNotKnownIsRefusedWithTheFormThatIs) {
  try {
    (void)readTide("harmonic", kStart);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::AllOf(::testing::HasSubstr("tide_model"),
                                               ::testing::HasSubstr("sinusoid amplitude_m=A")));
  }
  EXPECT_FALSE(readTide("none", kStart));
}

}  // namespace
}  // namespace fathom
