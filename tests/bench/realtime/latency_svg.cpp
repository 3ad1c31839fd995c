#include "tests/bench/realtime/latency_svg.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "realtime/kernel/text.hpp"

namespace fathom::bench {
namespace {

constexpr double kWidth = 1400, kHeight = 560, kTop = 96, kBottom = 500;
constexpr double kLeft = 90, kMiddle = 860, kRightLeft = 950, kRight = 1370;
constexpr std::array<const char*, 2> kColours{"#2266aa", "#cc5533"};
constexpr double kP999 = 99.9;

// A logarithmic axis from `low` to `high` onto two places of the picture.
struct LogAxis {
  double low = 1, high = 10, from = 0, to = 1;
  [[nodiscard]] double operator()(double value) const {
    const double share = std::log(std::clamp(value, low, high) / low) / std::log(high / low);
    return from + share * (to - from);
  }
};

LatencyHistogram together(const LatencySeries& series) {
  LatencyHistogram all;
  for (const LatencyHistogram& minute : series.minutes) all.merge(minute);
  return all;
}

std::string line(double x1, double y1, double x2, double y2, const char* style) {
  return formatted("<line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f' %s/>", x1, y1, x2, y2, style);
}

std::string text(double x, double y, const char* anchor, const char* kind, const std::string& words) {
  return formatted("<text x='%.1f' y='%.1f' text-anchor='%s' class='%s'>%s</text>", x, y, anchor, kind,
                   words.c_str());
}

std::string power(int exponent) {
  if (exponent >= 0) return formatted("%.0f", std::pow(10.0, exponent));
  return formatted("%.*f %%", std::max(0, -exponent - 2), std::pow(10.0, exponent + 2));
}

std::string grid(const LogAxis& x, const LogAxis& y) {
  std::string svg;
  for (int e = 0; std::pow(10.0, e) <= x.high * 1.001; ++e)
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double us = factor * std::pow(10.0, e);
      if (us < x.low || us > x.high * 1.001) continue;
      svg += line(x(us), kTop, x(us), kBottom, "class='grid'");
      svg += text(x(us), kBottom + 18, "middle", "axis", formatted("%.0f", us));
    }
  for (int e = 0; std::pow(10.0, e) >= y.low * 0.999; --e) {
    const double at = y(std::pow(10.0, e));
    svg += line(kLeft, at, kMiddle, at, "class='grid'") + text(kLeft - 8, at + 4, "end", "axis", power(e));
  }
  return svg + text((kLeft + kMiddle) / 2, kBottom + 40, "middle", "name", "wake-up latency, us") +
         text(kLeft, kTop - 14, "start", "name", "share of wake-ups later than that");
}

std::string curve(const LatencyHistogram& all, const LogAxis& x, const LogAxis& y, const char* colour,
                  const std::string& name, int place) {
  std::string svg = formatted("<path fill='none' stroke='%s' stroke-width='2.2' d='M", colour);
  std::uint64_t below = 0;
  double last = y(1.0);
  svg += formatted("%.1f %.1f", x(x.low), last);
  for (std::size_t us = 0; us < all.counts().size(); ++us) {
    if (all.counts()[us] == 0) continue;
    below += all.counts()[us];
    const double share = static_cast<double>(all.count() - below) / static_cast<double>(all.count());
    const double at = y(std::max(share, y.low));
    svg += formatted(" H%.1f V%.1f", x(static_cast<double>(us) + 1), at);
    last = at;
  }
  svg += "'/>\n";
  const double p999 = static_cast<double>(all.percentile(kP999));
  svg += formatted("<circle cx='%.1f' cy='%.1f' r='5' fill='%s'/>", x(p999), y(1e-3), colour);
  const double label_y = kTop + 24 + 22 * place;
  svg += line(kMiddle - 340, label_y - 5, kMiddle - 312, label_y - 5,
              formatted("stroke='%s' stroke-width='3'", colour).c_str());
  svg += text(
      kMiddle - 304, label_y, "start", "key",
      name + formatted(": p50 %lld, p99.9 %lld, max %lld us", static_cast<long long>(all.percentile(50)),
                       static_cast<long long>(all.percentile(kP999)), static_cast<long long>(all.max())));
  return svg;
}

std::string minutesPanel(const std::array<const LatencySeries*, 2>& series, const LogAxis& y) {
  std::string svg;
  for (int e = 0; std::pow(10.0, e) <= y.high * 1.001; ++e) {
    const double us = std::pow(10.0, e);
    if (us < y.low) continue;
    svg += line(kRightLeft, y(us), kRight, y(us), "class='grid'") +
           text(kRightLeft - 8, y(us) + 4, "end", "axis", formatted("%.0f", us));
  }
  const std::size_t minutes = std::max<std::size_t>(series[0]->minutes.size(), 1);
  const double step = (kRight - kRightLeft) / static_cast<double>(minutes);
  for (std::size_t s = 0; s < series.size(); ++s)
    for (std::size_t i = 0; i < series[s]->minutes.size(); ++i) {
      const LatencyHistogram& minute = series[s]->minutes[i];
      const double x = kRightLeft + step * (static_cast<double>(i) + (s == 0 ? 0.3 : 0.7));
      const double worst = y(static_cast<double>(minute.max())),
                   p999 = y(static_cast<double>(minute.percentile(kP999)));
      svg += line(x, worst, x, p999,
                  formatted("stroke='%s' stroke-width='1' opacity='.5'", kColours[s]).c_str());
      svg += formatted("<circle cx='%.1f' cy='%.1f' r='4' fill='%s'/>", x, p999, kColours[s]);
      svg += formatted("<path d='M%.1f %.1f h8' stroke='%s' stroke-width='2'/>", x - 4, worst, kColours[s]);
    }
  return svg +
         text((kRightLeft + kRight) / 2, kBottom + 40, "middle", "name", "minutes, one after the other") +
         text(kRightLeft, kTop - 14, "start", "name", "each minute: p99.9 (dot), maximum (bar), us");
}

}  // namespace

std::string latencySvg(const std::string& title, const LatencySeries& ours, const LatencySeries& theirs) {
  const LatencyHistogram a = together(ours), b = together(theirs);
  const double latest = static_cast<double>(std::max({a.max(), b.max(), std::int64_t{10}}));
  const auto most = static_cast<double>(std::max({a.count(), b.count(), std::uint64_t{10}}));
  const LogAxis x{1, std::pow(10.0, std::ceil(std::log10(latest))), kLeft, kMiddle};
  const LogAxis y{std::pow(10.0, std::floor(-std::log10(most))), 1.0, kBottom, kTop};
  const LogAxis y_minutes{1, x.high, kBottom, kTop};

  std::string svg = formatted(
      "<svg xmlns='http://www.w3.org/2000/svg' width='%.0f' height='%.0f' viewBox='0 0 %.0f %.0f'>\n", kWidth,
      kHeight, kWidth, kHeight);
  svg +=
      "<style>text{font-family:'DejaVu Sans',sans-serif;font-size:13px;fill:#222}.title{font-size:19px;"
      "font-weight:bold}.name{font-weight:bold}.axis{font-size:11px;fill:#667}.grid{stroke:#dde2e9}"
      "</style><rect width='100%' height='100%' fill='#fff'/>\n";
  svg += text(24, 36, "start", "title", title) + grid(x, y);
  svg += line(kLeft, y(1e-3), kMiddle, y(1e-3), "stroke='#555' stroke-dasharray='5 4'");
  svg += curve(a, x, y, kColours[0], ours.name, 0) + curve(b, x, y, kColours[1], theirs.name, 1);
  svg += minutesPanel({&ours, &theirs}, y_minutes);
  return svg + "</svg>\n";
}

}  // namespace fathom::bench
