#pragma once

#include <cmath>
#include <numbers>

// What the C library rounds differently from one processor to the next: its hypot, exp2, erfc and lgamma use
// a fused multiply-add where the processor has one (glibc 2.36, arm64 against x86-64), so that their last bit
// is not the same. Here they are made of functions whose results are: sqrt (IEEE 754), and exp, which glibc
// computes alike on arm64 and on every x86-64 with FMA, as it does sin, cos, tan, asin, acos, atan, atan2,
// log, log1p, sinh and pow, all of double. Tests hold these to digests.
namespace fathom {

// Without std::hypot's care for squares beyond double's range.
[[nodiscard]] inline double hypotenuse(double a, double b) {
  return std::sqrt(a * a + b * b);
}
[[nodiscard]] inline double hypotenuse(double a, double b, double c) {
  return std::sqrt(a * a + b * b + c * c);
}

// 2^x; exact for whole numbers.
[[nodiscard]] inline double powerOfTwo(double x) {
  const double whole = std::floor(x);
  return std::ldexp(std::exp((x - whole) * std::numbers::ln2), static_cast<int>(whole));
}

// Share of a standard normal distribution below x, within 1e-7: Abramowitz and Stegun 1964, 26.2.17.
[[nodiscard]] inline double shareBelow(double x) {
  const double t = 1 / (1 + 0.2316419 * std::abs(x));
  const double tail =
      0.3989422804014327 * std::exp(-0.5 * x * x) * t *
      (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))));
  return x < 0 ? tail : 1 - tail;
}

// ln n!, n >= 0, within 1e-10: Stirling's series.
[[nodiscard]] inline double logFactorial(double n) {
  constexpr double kLeast = 10;
  double shift = 0;  // ln of what the series begins beyond
  for (; n < kLeast; n += 1) shift += std::log(n + 1);
  const double inverse = 1 / n, square = inverse * inverse;
  return n * std::log(n) - n + 0.5 * std::log(2 * std::numbers::pi * n) +
         inverse * (1.0 / 12 - square * (1.0 / 360 - square * (1.0 / 1260 - square / 1680))) - shift;
}

}  // namespace fathom
