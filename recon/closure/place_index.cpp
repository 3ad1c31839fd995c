#include "recon/closure/place_index.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <random>
#include <stdexcept>
#include <tuple>

#include "realtime/base/bytes/state_archive.hpp"

namespace fathom::closure {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("PLAC"), kVersion = 1;
constexpr std::size_t kWords = std::size_t{1} << PlaceIndex::kWordBits;
constexpr double kScore = 16;  // units of a score in one bit of information

// Coefficients of the hyperplanes, random signs. The values of a root-SIFT descriptor have different means,
// so hyperplanes through the origin would leave most descriptors on one side. Two values that mirror each
// other about the axis of the main gradient have the same mean, as a texture and its mirror image are equally
// likely. Each hyperplane is a sum of differences of such pairs: its sign is balanced.
std::vector<std::int16_t> planes(int bits) {
  constexpr int kSide = 4, kOrientations = 8;
  std::mt19937 random(20101);
  std::vector<std::int16_t> signs(static_cast<std::size_t>(bits) * kDescriptorBytes, 0);
  for (int bit = 0; bit < bits; ++bit) {
    std::int16_t* w = signs.data() + static_cast<std::ptrdiff_t>(bit) * kDescriptorBytes;
    for (int row = 0; row < kSide / 2; ++row)
      for (int column = 0; column < kSide; ++column)
        for (int o = 0; o < kOrientations; ++o) {
          const int here = (row * kSide + column) * kOrientations + o;
          const int mirrored =
              ((kSide - 1 - row) * kSide + column) * kOrientations + (kOrientations - o) % kOrientations;
          const auto sign = static_cast<std::int16_t>((random() & 1U) != 0 ? 1 : -1);
          w[here] = sign;
          w[mirrored] = static_cast<std::int16_t>(-sign);
        }
  }
  return signs;
}

}  // namespace

PlaceIndex::PlaceIndex(const PlaceIndexConfig& config)
    : config_(config), planes_(planes(kWordBits + kSignatureBits)) {
  constexpr int kMostPlaces = 1 << kSlotBits, kMostFeatures = 10000;
  if (config.max_places < 1 || config.max_places > kMostPlaces || config.features < 1 ||
      config.features > kMostFeatures || config.compared < 1 || config.least_features < 1)
    throw std::invalid_argument("place index: configuration out of range");
  const auto places = static_cast<std::size_t>(config.max_places);
  const auto features = static_cast<std::size_t>(config.features);
  blocks_.resize(places * features / kBlockEntries + std::min(kWords, places * features) + 1);
  heads_.resize(kWords);
  lengths_.resize(kWords);
  words_.resize(places * features);
  counts_.resize(places);
  free_slots_.reserve(places);
  ids_.reserve(places);
  codes_.resize(features);
  probes_.reserve(features);
  scores_.resize(places);
  is_met_.resize(places);
  matched_.reserve(places);
  best_.reserve(places);
  clear();
}

void PlaceIndex::clear() {
  for (std::size_t b = 0; b < blocks_.size(); ++b) blocks_[b].next = static_cast<std::int32_t>(b) + 1;
  blocks_.back().next = -1;
  free_block_ = 0;
  std::fill(heads_.begin(), heads_.end(), -1);
  std::fill(lengths_.begin(), lengths_.end(), 0);
  std::fill(counts_.begin(), counts_.end(), std::uint16_t{0});
  free_slots_.clear();
  for (int slot = config_.max_places; slot-- > 0;) free_slots_.push_back(slot);
  ids_.clear();
}

std::size_t PlaceIndex::memoryBytes() const {
  return blocks_.size() * sizeof(Block) + words_.size() * sizeof(Word) + 2 * kWords * sizeof(std::int32_t) +
         planes_.size() * sizeof(std::int16_t) + codes_.size() * (sizeof(Code) + sizeof(Probe)) +
         counts_.size() * (sizeof(std::uint16_t) + 3 * sizeof(std::int32_t) + sizeof(std::uint8_t) +
                           sizeof(Id) + sizeof(Place));
}

std::size_t PlaceIndex::featuresOf(const FrameFeatures& frame) const {
  const auto count = std::min(frame.size(), static_cast<std::size_t>(config_.features));
  return count >= static_cast<std::size_t>(config_.least_features) ? count : 0;
}

void PlaceIndex::code(const std::uint8_t* descriptor, Code& code) const {
  std::array<std::int16_t, kDescriptorBytes> x;
  std::copy_n(descriptor, kDescriptorBytes, x.begin());
  std::array<std::int32_t, kWordBits + kSignatureBits> side{};
  for (std::size_t bit = 0; bit < side.size(); ++bit) {
    const std::int16_t* w = planes_.data() + bit * kDescriptorBytes;
    std::int32_t sum = 0;
    for (std::size_t k = 0; k < kDescriptorBytes; ++k) sum += w[k] * x[k];
    side[bit] = sum;
  }
  code = {};
  for (int bit = 0; bit < kWordBits; ++bit)
    code.word = static_cast<Word>(code.word | (side[static_cast<std::size_t>(bit)] > 0 ? 1 << bit : 0));
  for (int bit = 0; bit < kSignatureBits; ++bit)
    if (side[static_cast<std::size_t>(kWordBits + bit)] > 0) code.signature |= Entry{1} << (kSlotBits + bit);
  std::array<Word, kWordBits> bits;
  for (std::size_t bit = 0; bit < bits.size(); ++bit) bits[bit] = static_cast<Word>(bit);
  std::partial_sort(bits.begin(), bits.begin() + kProbeBits, bits.end(), [&](Word a, Word b) {
    return std::tuple(std::abs(side[a]), a) < std::tuple(std::abs(side[b]), b);
  });
  std::copy_n(bits.begin(), kProbeBits, code.least_sure.begin());
}

// Only the first block of a list may be partly filled, so the pool of blocks never runs out.
void PlaceIndex::insertEntry(Word word, Entry entry) {
  std::int32_t& head = heads_[word];
  if (head < 0 || blocks_[static_cast<std::size_t>(head)].count == static_cast<int>(kBlockEntries)) {
    const std::int32_t block = free_block_;
    Block& fresh = blocks_[static_cast<std::size_t>(block)];
    free_block_ = fresh.next;
    fresh.next = head;
    fresh.count = 0;
    head = block;
  }
  Block& block = blocks_[static_cast<std::size_t>(head)];
  block.entries[static_cast<std::size_t>(block.count++)] = entry;
  ++lengths_[word];
}

// Removes one entry of the slot; the list's last entry fills the gap.
void PlaceIndex::eraseEntry(Word word, std::int32_t slot) {
  std::int32_t& head = heads_[word];
  for (std::int32_t at = head; at >= 0; at = blocks_[static_cast<std::size_t>(at)].next) {
    Block& block = blocks_[static_cast<std::size_t>(at)];
    for (int i = 0; i < block.count; ++i) {
      if ((block.entries[static_cast<std::size_t>(i)] & kSlots) != static_cast<Entry>(slot)) continue;
      Block& first = blocks_[static_cast<std::size_t>(head)];
      block.entries[static_cast<std::size_t>(i)] = first.entries[static_cast<std::size_t>(--first.count)];
      --lengths_[word];
      if (first.count > 0) return;
      const std::int32_t empty = head;
      head = first.next;
      first.next = free_block_;
      free_block_ = empty;
      return;
    }
  }
}

bool PlaceIndex::add(int id, const FrameFeatures& frame) {
  const std::size_t count = featuresOf(frame);
  if (count == 0 || free_slots_.empty() || (!ids_.empty() && ids_.back().id >= id)) return false;
  const std::int32_t slot = free_slots_.back();
  free_slots_.pop_back();
  ids_.push_back({id, slot});
  counts_[static_cast<std::size_t>(slot)] = static_cast<std::uint16_t>(count);
  Word* words = words_.data() + static_cast<std::ptrdiff_t>(slot) * config_.features;
  for (std::size_t i = 0; i < count; ++i) {
    code(frame.descriptor(i), codes_[i]);
    words[i] = codes_[i].word;
    insertEntry(words[i], codes_[i].signature | static_cast<Entry>(slot));
  }
  return true;
}

void PlaceIndex::remove(int id) {
  const auto at =
      std::lower_bound(ids_.begin(), ids_.end(), id, [](const Id& x, int wanted) { return x.id < wanted; });
  if (at == ids_.end() || at->id != id) return;
  const auto slot = static_cast<std::size_t>(at->slot);
  const Word* words = words_.data() + slot * static_cast<std::size_t>(config_.features);
  for (int i = 0; i < counts_[slot]; ++i) eraseEntry(words[i], at->slot);
  counts_[slot] = 0;
  free_slots_.push_back(at->slot);
  ids_.erase(at);
}

// The code's word with some of its least sure bits flipped.
PlaceIndex::Word PlaceIndex::probeWord(const Code& code, unsigned flips) {
  Word word = code.word;
  for (unsigned k = 0; k < kProbeBits; ++k)
    if ((flips >> k & 1U) != 0) word = static_cast<Word>(word ^ 1U << code.least_sure[k]);
  return word;
}

// Collects the slots matched by one feature, each once, and adds the match's information to their scores:
// minus the logarithm of the share of all slots that match.
void PlaceIndex::countMatches(const Code& code) {
  matched_.clear();
  for (unsigned flips = 0; flips < 1U << kProbeBits; ++flips) {
    const Word word = probeWord(code, flips);
    for (std::int32_t at = heads_[word]; at >= 0; at = blocks_[static_cast<std::size_t>(at)].next) {
      const Block& block = blocks_[static_cast<std::size_t>(at)];
      for (int i = 0; i < block.count; ++i) {
        const Entry entry = block.entries[static_cast<std::size_t>(i)];
        if (std::popcount((entry ^ code.signature) & ~kSlots) > kMostDifferent) continue;
        const auto slot = static_cast<std::size_t>(entry & kSlots);
        if (is_met_[slot] != 0) continue;
        is_met_[slot] = 1;
        matched_.push_back(static_cast<std::int32_t>(slot));
      }
    }
  }
  const double share = static_cast<double>(matched_.size()) / static_cast<double>(ids_.size() + 1);
  const auto worth =
      matched_.empty() ? 0 : static_cast<std::int32_t>(std::lround(-kScore * std::log2(share)));
  for (const std::int32_t slot : matched_) {
    scores_[static_cast<std::size_t>(slot)] += worth;
    is_met_[static_cast<std::size_t>(slot)] = 0;
  }
}

std::span<const PlaceIndex::Place> PlaceIndex::query(const FrameFeatures& frame, std::size_t most,
                                                     const std::function<bool(int id)>& accept) {
  best_.clear();
  probes_.clear();
  const std::size_t count = featuresOf(frame);
  for (std::size_t i = 0; i < count; ++i) {
    Code& code = codes_[i];
    this->code(frame.descriptor(i), code);
    Probe probe{0, static_cast<std::int32_t>(i)};
    for (unsigned flips = 0; flips < 1U << kProbeBits; ++flips)
      probe.length += lengths_[probeWord(code, flips)];
    probes_.push_back(probe);
  }
  std::sort(probes_.begin(), probes_.end(), [](const Probe& x, const Probe& y) {
    return std::tie(x.length, x.feature) < std::tie(y.length, y.feature);
  });
  std::fill(scores_.begin(), scores_.end(), 0);
  std::int64_t compared = 0;
  for (const Probe& probe : probes_) {
    compared += probe.length;
    if (compared > config_.compared) break;
    countMatches(codes_[static_cast<std::size_t>(probe.feature)]);
  }
  for (const Id& known : ids_) {
    const std::int32_t score = scores_[static_cast<std::size_t>(known.slot)];
    if (score > 0 && accept(known.id)) best_.push_back({known.id, score});
  }
  const std::size_t kept = std::min(most, best_.size());
  std::partial_sort(
      best_.begin(), best_.begin() + static_cast<std::ptrdiff_t>(kept), best_.end(),
      [](const Place& x, const Place& y) { return std::tie(y.score, y.id) < std::tie(x.score, x.id); });
  return {best_.data(), kept};
}

// Each list from its newest block to its oldest; load() reads it from the end, which restores the same
// blocks.
void PlaceIndex::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] {
    writer.bounded(ids_, ids_.capacity());
    writer.bounded(free_slots_, free_slots_.capacity());
    for (std::size_t word = 0; word < kWords; ++word) {
      writer(lengths_[word]);
      for (std::int32_t at = heads_[word]; at >= 0; at = blocks_[static_cast<std::size_t>(at)].next) {
        const Block& block = blocks_[static_cast<std::size_t>(at)];
        writer.elements(block.entries.data(), static_cast<std::size_t>(block.count));
      }
    }
  });
}

bool PlaceIndex::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] {
    clear();
    reader.bounded(ids_, ids_.capacity());
    reader.bounded(free_slots_, free_slots_.capacity());
    std::vector<std::uint8_t> met(counts_.size());
    const auto meet = [&](std::int32_t slot) {
      const bool good = slot >= 0 && slot < config_.max_places && met[static_cast<std::size_t>(slot)]++ == 0;
      reader.require(good, "a place that is not there, or comes twice");
    };
    reader.require(ids_.size() + free_slots_.size() == counts_.size(), "other places than there are");
    for (std::size_t i = 0; reader.ok() && i < ids_.size(); ++i) {
      meet(ids_[i].slot);
      reader.require(i == 0 || ids_[i - 1].id < ids_[i].id, "places out of order");
    }
    for (std::size_t i = 0; reader.ok() && i < free_slots_.size(); ++i) meet(free_slots_[i]);
    for (const std::int32_t slot : free_slots_)
      if (reader.ok()) met[static_cast<std::size_t>(slot)] = 0;
    std::vector<Entry> list;
    for (std::size_t word = 0; word < kWords && reader.ok(); ++word) {
      std::int32_t length = 0;
      reader(length);
      reader.require(length >= 0 && static_cast<std::size_t>(length) <= words_.size(), "a list too long");
      if (!reader.ok()) return;
      list.resize(static_cast<std::size_t>(length));
      reader.elements(list.data(), list.size());
      for (std::size_t end = list.size(); end > 0;) {
        const std::size_t first = end > kBlockEntries ? end - kBlockEntries : 0;
        for (std::size_t i = first; i < end && reader.ok(); ++i) {
          const auto slot = static_cast<std::size_t>(list[i] & kSlots);
          const bool good = slot < met.size() && met[slot] != 0 && counts_[slot] < config_.features;
          reader.require(good, "a feature of a place that is not stored");
          if (!good) return;
          words_[slot * static_cast<std::size_t>(config_.features) + counts_[slot]++] =
              static_cast<Word>(word);
          insertEntry(static_cast<Word>(word), list[i]);
        }
        end = first;
      }
    }
  });
}

Agreement::Agreement() {
  waiting_.reserve(kWaiting + 1);
  agreed_.reserve(kWaiting + 1);
}

// Adds a claim to agreed_ if it agrees with all claims there.
bool Agreement::join(const Claim& claim, const Odometry& odometry) {
  for (const Claim& other : agreed_) {
    const int da = std::abs(other.a - claim.a), db = std::abs(other.b - claim.b);
    if (da + db == 0 || da > kNeighbours || db > kNeighbours) return false;
    const RelativePrior side = odometry(claim.a, other.a), far_side = odometry(claim.b, other.b);
    if (!(cycleDistance2({claim.T_a_b, claim.covariance}, far_side, side, {other.T_a_b, other.covariance}) <
          kCycleGate))
      return false;
  }
  agreed_.push_back(claim);
  return true;
}

std::span<const Claim> Agreement::add(const Claim& claim, const Odometry& odometry) {
  agreed_.assign(1, claim);
  for (std::size_t i = waiting_.size(); i-- > 0;) (void)join(waiting_[i], odometry);
  int required = 0;
  bool several_a = false, several_b = false;
  double baseline = 0, extent_a = 0, extent_b = 0;
  for (const Claim& x : agreed_) {
    required = std::max(required, x.wanted);
    baseline = std::max(baseline, x.baseline);
    for (const Claim& y : agreed_) {
      if (&x == &y) break;
      several_a = several_a || x.a != y.a;
      several_b = several_b || x.b != y.b;
      extent_a = std::max(extent_a, odometry(x.a, y.a).T_a_b.translation().norm());
      extent_b = std::max(extent_b, odometry(x.b, y.b).T_a_b.translation().norm());
    }
  }
  const bool independent = several_a && several_b && std::min(extent_a, extent_b) >= baseline;
  if (static_cast<int>(agreed_.size()) < required || !independent) {
    if (waiting_.size() == kWaiting) {
      waiting_.erase(waiting_.begin());
      ++forgotten_;
    }
    waiting_.push_back(claim);
    return {};
  }
  std::reverse(agreed_.begin(), agreed_.end());
  std::erase_if(waiting_, [&](const Claim& w) {
    return std::any_of(agreed_.begin(), agreed_.end(),
                       [&](const Claim& x) { return x.a == w.a && x.b == w.b; });
  });
  return agreed_;
}

RegistrationConfig recognitionRules() {
  RegistrationConfig rules;
  rules.min_inliers = 30;
  rules.min_inlier_share = 0.15;
  rules.min_significance = 30;
  return rules;
}

bool fitsDownAndDepth(const SE3& T_nav_a, const SE3& T_nav_b, const SE3& T_a_b) {
  constexpr double kTilt = 0.1;   // between the two directions of down [rad]
  constexpr double kDepth = 0.5;  // tolerance for errors of the predicted tide between two visits [m]
  const SE3 T_nav_b_found = T_nav_a * T_a_b;
  const Eigen::Vector3d found = T_nav_b_found.rotation().inverse() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d known = T_nav_b.rotation().inverse() * Eigen::Vector3d::UnitZ();
  return std::atan2(found.cross(known).norm(), found.dot(known)) < kTilt &&
         std::abs(T_nav_b_found.translation().z() - T_nav_b.translation().z()) < kDepth;
}

Claim recognitionOf(int a, int b, const UncertainPose& found, int inliers, double radius) {
  constexpr int kWanted = 3;
  constexpr double kBaseline = 0.5;  // of the footprint's radius: over less, the frames are not independent
  return {a, b, found.T_a_b, found.covariance, inliers, kWanted, kBaseline * radius};
}

}  // namespace fathom::closure
