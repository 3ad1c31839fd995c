#include "telemetry/repair/repair.hpp"

#include <isa-l/erasure_code.h>

#include <algorithm>
#include <cmath>

namespace fathom::telemetry {
namespace {

constexpr double kSigmas = 2.33;  // one-sided 0.99

std::uint8_t coefficient(int row, int column) {
  return gf_inv(static_cast<std::uint8_t>((kMaxGroup + row) ^ column));
}

// target += factor * source
void addScaled(std::span<std::uint8_t> target, std::uint8_t factor, std::span<const std::uint8_t> source) {
  for (std::size_t i = 0; i < source.size(); ++i)
    target[i] = static_cast<std::uint8_t>(target[i] ^ gf_mul(factor, source[i]));
}

}  // namespace

int repairRows(int k, double loss, double burst) {
  if (k <= 0 || loss <= 0) return 0;
  loss = std::min(loss, 0.9);
  const double correlation = std::clamp(1 - (1 + loss / (1 - loss)) / std::max(burst, 1.0), 0.0, 0.95);
  const double spread = loss * (1 - loss) * (1 + correlation) / (1 - correlation);
  for (int rows = 1; rows < kMaxRepairRows; ++rows) {
    const double n = k + rows;
    if (n * (1 - loss) - k >= kSigmas * std::sqrt(n * spread)) return rows;
  }
  return kMaxRepairRows;
}

RepairEncoder::RepairEncoder() : closed_(kGroups) {}

std::size_t RepairEncoder::memoryBytes() const {
  return sizeof(*this) + closed_.size() * sizeof(Group);
}

void RepairEncoder::clear() {
  open_.k = 0;
  for (Group& g : closed_) g.wanted = g.rows = 0;
  pending_ = 0;
  credit_ = spread_ = 0;
}

void RepairEncoder::source(Version version, std::span<const std::uint8_t> payload, bool is_map, double loss,
                           double burst) {
  if (open_.k > 0 && version != open_.first + static_cast<Version>(open_.k)) open_.k = 0;
  if (open_.k == 0) {
    if (!is_map) return;  // nothing to repair yet
    open_.first = version;
    open_.has_map = false;
    open_.symbol_bytes = 0;
  }
  auto& symbol = open_.symbol[static_cast<std::size_t>(open_.k)];
  const bool protect = is_map && makeSymbol(payload, true, symbol);
  if (!protect) symbol.fill(0);
  if (protect) open_.symbol_bytes = std::max(open_.symbol_bytes, payload.size() + 1);
  open_.has_map = open_.has_map || protect;
  credit_ += spread_;
  if (++open_.k == kMaxGroup) close(loss, burst);
}

void RepairEncoder::close(double loss, double burst) {
  if (open_.k == 0) return;
  if (open_.has_map) {
    Group& g = *std::min_element(closed_.begin(), closed_.end(), [](const Group& a, const Group& b) {
      return a.wanted - a.rows < b.wanted - b.rows;
    });
    pending_ -= g.wanted - g.rows;
    g = open_;
    g.rows = 0;
    g.wanted = repairRows(g.k, loss, burst);
    pending_ += g.wanted;
    spread_ = static_cast<double>(pending_) / g.k;
    credit_ = 0;
  }
  open_.k = 0;
}

RepairEncoder::Row RepairEncoder::next(std::span<std::uint8_t> out) {
  for (std::size_t tries = 0; tries < closed_.size(); ++tries) {
    turn_ = (turn_ + 1) % closed_.size();
    Group& g = closed_[turn_];
    if (g.rows == g.wanted) continue;
    const std::size_t size = kRepairHeadBytes + g.symbol_bytes;
    if (size > out.size()) {  // frames became smaller since
      pending_ -= g.wanted - g.rows;
      g.rows = g.wanted;
      continue;
    }
    const int row = g.rows++;
    --pending_;
    credit_ = std::max(0.0, credit_ - 1);
    out[0] = static_cast<std::uint8_t>(g.k - 1);
    out[1] = static_cast<std::uint8_t>(row);
    const auto symbol = out.subspan(kRepairHeadBytes, g.symbol_bytes);
    std::fill(symbol.begin(), symbol.end(), std::uint8_t{0});
    std::uint32_t digest = 0;
    for (int j = 0; j < g.k; ++j) {
      const auto& member = g.symbol[static_cast<std::size_t>(j)];
      digest = digestSymbol(digest, std::span(member).first(g.symbol_bytes));
      const std::uint8_t factor = gf_inv(static_cast<std::uint8_t>((kMaxGroup + row) ^ j));
      for (std::size_t i = 0; i < symbol.size(); ++i)
        symbol[i] = static_cast<std::uint8_t>(symbol[i] ^ gf_mul(factor, member[i]));
    }
    return {size, g.first, groupDigest(digest)};
  }
  return {};
}

RepairDecoder::RepairDecoder() : frames_(kWindow), groups_(kGroups) {}

void RepairDecoder::clear() {
  for (Frame& f : frames_) f.held = false;
  for (Group& g : groups_) g.used = false;
}

std::size_t RepairDecoder::memoryBytes() const {
  return frames_.size() * sizeof(Frame) + groups_.size() * sizeof(Group);
}

const RepairDecoder::Frame* RepairDecoder::find(std::uint16_t sequence) const {
  const Frame& f = frames_[sequence % kWindow];
  return f.held && f.sequence == sequence ? &f : nullptr;
}

void RepairDecoder::source(std::uint16_t sequence, std::span<const std::uint8_t> payload, bool is_map) {
  Frame& f = frames_[sequence % kWindow];
  if (payload.size() > f.payload.size()) return;
  f.held = true;
  f.is_map = is_map;
  f.sequence = sequence;
  f.size = static_cast<std::uint8_t>(payload.size());
  std::copy(payload.begin(), payload.end(), f.payload.begin());
}

RepairDecoder::Group& RepairDecoder::groupFor(std::uint16_t first, int k, std::size_t symbol_bytes,
                                              std::optional<std::uint8_t> digest) {
  for (Group& g : groups_)
    if (g.used && g.first == first && g.k == k && g.symbol_bytes == symbol_bytes && g.digest == digest)
      return g;
  const auto rank = [](const Group& g) { return !g.used ? 0 : g.done ? 1 : 2; };
  Group& g = *std::min_element(groups_.begin(), groups_.end(), [&](const Group& a, const Group& b) {
    return rank(a) != rank(b) ? rank(a) < rank(b) : a.touched < b.touched;
  });
  if (g.used && !g.done) ++counters_.evicted;
  g.used = true;
  g.done = false;
  g.first = first;
  g.k = k;
  g.rows = 0;
  g.symbol_bytes = symbol_bytes;
  g.digest = digest;
  g.seen.reset();
  return g;
}

RepairDecoder::Taken RepairDecoder::repair(std::uint16_t first, std::span<const std::uint8_t> payload,
                                           std::optional<std::uint8_t> digest) {
  if (payload.size() < kRepairHeadBytes + 2 || payload.size() > kRepairHeadBytes + kMaxSymbolBytes)
    return Taken::kInvalid;
  const int k = payload[0] + 1;
  const std::size_t row = payload[1];
  if (k > kMaxGroup || row >= kMaxRepairRows) return Taken::kInvalid;
  const auto symbol = payload.subspan(kRepairHeadBytes);
  Group& g = groupFor(first, k, symbol.size(), digest);
  g.touched = ++clock_;
  if (g.seen[row]) return Taken::kDuplicate;
  g.seen[row] = true;
  if (g.done || g.rows == k) return Taken::kTaken;
  Row& r = g.row[static_cast<std::size_t>(g.rows++)];
  r.row = static_cast<std::uint8_t>(row);
  std::copy(symbol.begin(), symbol.end(), r.symbol.begin());
  return Taken::kTaken;
}

// The digest of a group whose missing members, in order, have these symbols.
std::uint8_t RepairDecoder::digestWith(const Group& g, std::span<const int> missing,
                                       std::span<const std::uint8_t> solved) const {
  std::array<std::uint8_t, kMaxSymbolBytes> known;
  std::uint32_t digest = 0;
  std::size_t next = 0;
  for (int j = 0; j < g.k; ++j) {
    auto symbol = std::span<const std::uint8_t>(known).first(g.symbol_bytes);
    if (next < missing.size() && missing[next] == j) {
      symbol = solved.subspan(next++ * g.symbol_bytes, g.symbol_bytes);
    } else {
      const Frame* f = find(static_cast<std::uint16_t>(g.first + j));
      (void)makeSymbol(std::span(f->payload).first(f->size), f->is_map,
                       std::span(known).first(g.symbol_bytes));
    }
    digest = digestSymbol(digest, symbol);
  }
  return groupDigest(digest);
}

RepairDecoder::Outcome RepairDecoder::solve(
    Group& g, const std::function<void(std::uint16_t, std::span<const std::uint8_t>)>& give) {
  std::array<int, kMaxGroup> missing;
  std::size_t n = 0;
  for (int j = 0; j < g.k; ++j)
    if (find(static_cast<std::uint16_t>(g.first + j)) == nullptr) missing[n++] = j;
  if (n == 0) return Outcome::kSolved;
  if (static_cast<std::size_t>(g.rows) < n) return Outcome::kNotYet;

  // Each row minus what is known of it; then the missing symbols from the square system that is left.
  std::array<std::uint8_t, kMaxSymbolBytes> known;
  const auto symbol = std::span(known).first(g.symbol_bytes);
  for (int j = 0; j < g.k; ++j) {
    const Frame* f = find(static_cast<std::uint16_t>(g.first + j));
    if (f == nullptr || !f->is_map) continue;
    if (!makeSymbol(std::span(f->payload).first(f->size), true, symbol)) return Outcome::kContradiction;
    for (std::size_t r = 0; r < n; ++r) addScaled(g.row[r].symbol, coefficient(g.row[r].row, j), symbol);
  }
  std::array<std::uint8_t, kMaxGroup * kMaxGroup> matrix, inverse;
  for (std::size_t r = 0; r < n; ++r)
    for (std::size_t c = 0; c < n; ++c) matrix[r * n + c] = coefficient(g.row[r].row, missing[c]);
  if (gf_invert_matrix(matrix.data(), inverse.data(), static_cast<int>(n)) != 0)
    return Outcome::kContradiction;
  // All are checked before the first is given.
  std::array<std::uint8_t, kMaxGroup * kMaxSymbolBytes> solved{};
  const auto member = [&](std::size_t c) {
    return std::span(solved).subspan(c * g.symbol_bytes, g.symbol_bytes);
  };
  for (std::size_t c = 0; c < n; ++c) {
    for (std::size_t r = 0; r < n; ++r)
      addScaled(member(c), inverse[c * n + r], std::span(g.row[r].symbol).first(g.symbol_bytes));
    const std::size_t size = member(c)[0];
    if (size > g.symbol_bytes) return Outcome::kContradiction;
    const auto padding = member(c).subspan(std::max<std::size_t>(size, 1));
    if (std::any_of(padding.begin(), padding.end(), [](std::uint8_t byte) { return byte != 0; }))
      return Outcome::kContradiction;
  }
  if (g.digest && digestWith(g, std::span(missing).first(n), solved) != *g.digest)
    return Outcome::kContradiction;
  for (std::size_t c = 0; c < n; ++c)
    if (const std::size_t size = member(c)[0]; size > 0)
      give(static_cast<std::uint16_t>(g.first + missing[c]), member(c).subspan(1, size - 1));
  return Outcome::kSolved;
}

void RepairDecoder::solve(const std::function<void(std::uint16_t, std::span<const std::uint8_t>)>& give) {
  for (Group& g : groups_) {
    if (!g.used || g.done) continue;
    std::uint64_t given = 0;
    const Outcome outcome = solve(g, [&](std::uint16_t sequence, std::span<const std::uint8_t> payload) {
      source(sequence, payload, true);
      give(sequence, payload);
      ++given;
    });
    g.done = outcome != Outcome::kNotYet;
    counters_.solved += outcome == Outcome::kSolved && given > 0 ? 1 : 0;
    counters_.contradicted += outcome == Outcome::kContradiction ? 1 : 0;
  }
}

}  // namespace fathom::telemetry
