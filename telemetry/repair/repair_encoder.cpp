#include "telemetry/repair/repair_encoder.hpp"

#include <isa-l/erasure_code.h>

#include <algorithm>
#include <cmath>

namespace fathom::telemetry {
namespace {

constexpr double kSigmas = 2.33;  // one-sided 0.99

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

}  // namespace fathom::telemetry
