#include "tests/support/latency_histogram.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <random>

namespace fathom::test {
namespace {

constexpr int kDraws = 2000;
constexpr std::uint64_t kSeed = 1;
constexpr double kLow = 0.025, kHigh = 0.975;

// Latencies that occurred and how often, for sums over many draws.
struct Sparse {
  std::vector<std::pair<std::int64_t, std::uint64_t>> counts;
  std::uint64_t total = 0;
};

Sparse sparse(const LatencyHistogram& h) {
  Sparse s;
  for (std::size_t us = 0; us < h.counts().size(); ++us)
    if (h.counts()[us] > 0) s.counts.emplace_back(static_cast<std::int64_t>(us), h.counts()[us]);
  if (h.beyond() > 0)
    s.counts.emplace_back(static_cast<std::int64_t>(LatencyHistogram::kMicroseconds), h.beyond());
  s.total = h.count();
  return s;
}

// The percentile of some minutes together, from the late end: few latencies are there.
double pooled(const std::vector<Sparse>& minutes, const std::vector<std::size_t>& which, double percent,
              std::vector<std::uint64_t>& scratch) {
  std::fill(scratch.begin(), scratch.end(), 0);
  std::uint64_t total = 0;
  for (const std::size_t i : which) {
    for (const auto& [us, times] : minutes[i].counts) scratch[static_cast<std::size_t>(us)] += times;
    total += minutes[i].total;
  }
  const auto later =
      static_cast<std::uint64_t>(std::floor((100 - percent) / 100 * static_cast<double>(total)));
  std::uint64_t seen = 0;
  for (std::size_t us = scratch.size(); us-- > 0;) {
    seen += scratch[us];
    if (seen > later) return static_cast<double>(us);
  }
  return 0;
}

std::vector<Sparse> allSparse(const std::vector<LatencyHistogram>& minutes) {
  std::vector<Sparse> all;
  for (const LatencyHistogram& minute : minutes) all.push_back(sparse(minute));
  return all;
}

template <typename Statistic>
Interval bootstrap(std::size_t minutes, const Statistic& statistic) {
  std::vector<std::size_t> which(minutes);
  for (std::size_t i = 0; i < minutes; ++i) which[i] = i;
  Interval interval;
  interval.value = statistic(which);
  std::mt19937_64 random(kSeed);
  std::uniform_int_distribution<std::size_t> any(0, minutes - 1);
  std::vector<double> drawn;
  for (int draw = 0; draw < kDraws; ++draw) {
    for (std::size_t& i : which) i = any(random);
    drawn.push_back(statistic(which));
  }
  std::sort(drawn.begin(), drawn.end());
  const auto at = [&](double share) {
    return drawn[static_cast<std::size_t>(share * static_cast<double>(drawn.size() - 1))];
  };
  interval.low = at(kLow);
  interval.high = at(kHigh);
  return interval;
}

// A place for every latency up to the latest of all.
std::vector<std::uint64_t> makeScratch(const std::vector<Sparse>& minutes) {
  std::int64_t latest = 0;
  for (const Sparse& minute : minutes)
    if (!minute.counts.empty()) latest = std::max(latest, minute.counts.back().first);
  return std::vector<std::uint64_t>(static_cast<std::size_t>(latest) + 1, 0);
}

}  // namespace

void LatencyHistogram::add(std::int64_t latency_us, std::uint64_t times) noexcept {
  latency_us = std::max<std::int64_t>(latency_us, 0);
  if (latency_us >= static_cast<std::int64_t>(kMicroseconds)) {
    addBeyond(times, latency_us);
    return;
  }
  counts_[static_cast<std::size_t>(latency_us)] += times;
  count_ += times;
  if (times > 0) max_ = std::max(max_, latency_us);
}

void LatencyHistogram::addBeyond(std::uint64_t times, std::int64_t max_us) noexcept {
  beyond_ += times;
  count_ += times;
  max_ = std::max(max_, max_us);
}

void LatencyHistogram::merge(const LatencyHistogram& other) noexcept {
  for (std::size_t us = 0; us < counts_.size(); ++us) counts_[us] += other.counts_[us];
  count_ += other.count_;
  beyond_ += other.beyond_;
  max_ = std::max(max_, other.max_);
}

std::int64_t LatencyHistogram::percentile(double percent) const noexcept {
  const auto later =
      static_cast<std::uint64_t>(std::floor((100 - percent) / 100 * static_cast<double>(count_)));
  std::uint64_t seen = beyond_;
  if (seen > later) return static_cast<std::int64_t>(kMicroseconds);
  for (std::size_t us = counts_.size(); us-- > 0;) {
    seen += counts_[us];
    if (seen > later) return static_cast<std::int64_t>(us);
  }
  return 0;
}

std::optional<LatencyHistogram> readCyclictest(std::string_view printed) {
  LatencyHistogram histogram;
  std::uint64_t beyond = 0;
  std::int64_t max_us = 0;
  std::optional<std::uint64_t> total;
  // The number behind a key such as "# Max Latencies:".
  const auto value = [](std::string_view line, std::string_view key) -> std::optional<std::uint64_t> {
    if (!line.starts_with(key)) return std::nullopt;
    const std::size_t at = line.find_first_of("0123456789", key.size());
    std::uint64_t number = 0;
    if (at == std::string_view::npos ||
        std::from_chars(line.data() + at, line.data() + line.size(), number).ec != std::errc{})
      return std::nullopt;
    return number;
  };
  while (!printed.empty()) {
    const std::size_t end = printed.find('\n');
    const std::string_view line = printed.substr(0, end);
    printed.remove_prefix(end == std::string_view::npos ? printed.size() : end + 1);
    if (const auto found = value(line, "# Total:")) total = found;
    if (const auto found = value(line, "# Histogram Overflows:")) beyond = *found;
    if (const auto found = value(line, "# Max Latencies:")) max_us = static_cast<std::int64_t>(*found);
    // A row of the histogram: microseconds, then how often.
    std::int64_t us = 0;
    std::uint64_t times = 0;
    const char* last = line.data() + line.size();
    const auto first = std::from_chars(line.data(), last, us);
    if (first.ec != std::errc{} || first.ptr == last || (*first.ptr != ' ' && *first.ptr != '\t')) continue;
    const char* next = first.ptr;
    while (next != last && (*next == ' ' || *next == '\t')) ++next;
    if (std::from_chars(next, last, times).ec == std::errc{}) histogram.add(us, times);
  }
  if (!total || *total != histogram.count()) return std::nullopt;
  histogram.addBeyond(beyond, max_us);
  if (histogram.count() == 0) return std::nullopt;
  return histogram;
}

Interval percentileInterval(const std::vector<LatencyHistogram>& minutes, double percent) {
  if (minutes.empty()) return {};
  const std::vector<Sparse> all = allSparse(minutes);
  std::vector<std::uint64_t> scratch = makeScratch(all);
  return bootstrap(all.size(), [&](const std::vector<std::size_t>& which) {
    return pooled(all, which, percent, scratch);
  });
}

Interval ratioInterval(const std::vector<LatencyHistogram>& ours, const std::vector<LatencyHistogram>& theirs,
                       double percent) {
  const std::size_t minutes = std::min(ours.size(), theirs.size());
  if (minutes == 0) return {};
  const std::vector<Sparse> a = allSparse(ours), b = allSparse(theirs);
  std::vector<std::uint64_t> scratch_a = makeScratch(a), scratch_b = makeScratch(b);
  return bootstrap(minutes, [&](const std::vector<std::size_t>& which) {
    const double peer = std::max(pooled(b, which, percent, scratch_b), 1.0);
    return pooled(a, which, percent, scratch_a) / peer;
  });
}

}  // namespace fathom::test
