#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <vector>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom {
namespace {

TEST(PortableMath, AgreesWithTheLibrary) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> at(-6, 6);
  for (int k = 0; k < 100'000; ++k) {
    const double a = at(random), b = at(random), c = at(random);
    EXPECT_NEAR(hypotenuse(a, b), std::hypot(a, b), 4e-16 * std::hypot(a, b));
    EXPECT_NEAR(hypotenuse(a, b, c), std::hypot(a, b, c), 6e-16 * std::hypot(a, b, c));
    EXPECT_NEAR(powerOfTwo(a), std::exp2(a), 4e-16 * std::exp2(a));
    EXPECT_NEAR(shareBelow(a), 0.5 * std::erfc(-a / std::sqrt(2.0)), 1e-7);
    const double n = std::round(1000 * std::abs(a));
    EXPECT_NEAR(logFactorial(n), std::lgamma(n + 1), 1e-10 + 1e-14 * std::lgamma(n + 1));
  }
  for (int k = -40; k <= 40; ++k) EXPECT_EQ(powerOfTwo(k), std::ldexp(1.0, k));
}

// FNV-1a of the results' bytes over numbers drawn alike everywhere.
std::uint64_t digestOf(double from, double to, const std::function<double(double, double)>& function) {
  std::mt19937_64 random(1);
  const auto drawn = [&] { return from + (to - from) * static_cast<double>(random() >> 11) * 0x1p-53; };
  std::uint64_t digest = 0xcbf29ce484222325;
  for (int k = 0; k < 200'000; ++k) {
    const double a = drawn(), b = drawn();
    digest = (digest ^ std::bit_cast<std::uint64_t>(function(a, b))) * 0x100000001b3;
  }
  return digest;
}

TEST(PortableMath, GivesTheSameBytesOnEveryProcessorWithFma) {
#ifdef __x86_64__
  if (!__builtin_cpu_supports("fma"))
    GTEST_SKIP() << "this processor has no FMA: the C library rounds otherwise";
#endif
  struct Function {
    const char* name;
    double from, to;
    std::function<double(double, double)> function;
    std::uint64_t digest;
  };
  const auto one = [](double (*f)(double)) { return [f](double a, double) { return f(a); }; };
  const std::vector<Function> functions = {
      {"hypotenuse", -3, 3, [](double a, double b) { return hypotenuse(a, b); }, 0x33a34008ebaa0677},
      {"powerOfTwo", -9, 9, one(powerOfTwo), 0x3478a039373b17b8},
      {"shareBelow", -6, 6, one(shareBelow), 0x50cdf446f5d7116e},
      {"logFactorial", 0, 3000, one(logFactorial), 0xe3b8c76729ebb9bf},
      {"sin", -7, 7, one(std::sin), 0x457ddaafee7d7c26},
      {"cos", -7, 7, one(std::cos), 0x17f62de37674bb9b},
      {"tan", -1.5, 1.5, one(std::tan), 0xa05c465323768e50},
      {"asin", -1, 1, one(std::asin), 0x0d6a6bbc5a2ea49c},
      {"acos", -1, 1, one(std::acos), 0x4a36c84b337ff6d1},
      {"atan", -9, 9, one(std::atan), 0xb9833d9fc328ee77},
      {"atan2", -3, 3, [](double a, double b) { return std::atan2(a, b); }, 0xd08248d1c3983212},
      {"exp", -20, 20, one(std::exp), 0xa244a6ffd721196c},
      {"log", 1e-6, 100, one(std::log), 0x25566659f72e4549},
      {"log1p", -0.5, 3, one(std::log1p), 0xc5de4d888b41af77},
      {"log2", 1e-6, 100, one(std::log2), 0xd5b120a8da3891fd},
      {"sinh", -3, 3, one(std::sinh), 0xe74184f4d5704505},
      {"asinh", -5, 5, one(std::asinh), 0x774df792c5e366ae},
      {"atanh", -0.9, 0.9, one(std::atanh), 0x820a5857b88c1ca5},
      {"pow", 0, 4, [](double a, double b) { return std::pow(a, b); }, 0xe7b313b9e68104b9},
  };
  for (const Function& f : functions) EXPECT_EQ(digestOf(f.from, f.to, f.function), f.digest) << f.name;
}

}  // namespace
}  // namespace fathom
