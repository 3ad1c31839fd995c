#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/closure/registration.hpp"

// Recognition of a place by its looks alone: PlaceIndex proposes a pair of frames, a Registrar of stricter
// rules finds their relative pose without prior, the pose must fit the down and depth of even a lost vehicle,
// and several such pairs must agree.

namespace fathom::closure {

struct PlaceIndexConfig {
  int max_places = 12000;    // frames
  int features = 200;        // of a frame, the first, which are the strongest
  int compared = 1'500'000;  // signatures that a query compares, at most
  int least_features = 15;   // of a frame; with fewer it is not indexed
};

// Index of frames that may show the same place as a query, by their root-SIFT descriptors alone: without pose
// or training, at any heading (descriptors turn with the image).
//
// An inverted file with Hamming embedding (Jegou, Douze & Schmid 2008): each descriptor x becomes a word and
// a signature, the signs of w . x for kWordBits and kSignatureBits fixed pseudo-random hyperplanes w that
// have no bias to one side (place_index.cpp). Two descriptors match when their words are alike and their
// signatures differ in at most kMostDifferent bits; a query searches the words that differ from its own in
// the bits which are nearest to a change. A match scores by its rarity, log2 (places / matches of that
// feature): ripples match everywhere and score nothing.
//
// Fixed memory: 10 bytes a feature and the part of a block left empty by each word. A query compares a
// bounded number of signatures, those of the rarest words first. The result depends on the places held alone,
// not on the order of their additions and removals.
class PlaceIndex {
 public:
  static constexpr int kWordBits = 14, kSignatureBits = 44, kMostDifferent = 9;

  explicit PlaceIndex(const PlaceIndexConfig& config);

  // Ids must rise. False, and nothing is added, when the index is full or the frame has too few features.
  bool add(int id, const FrameFeatures& frame);
  // No effect for an unknown id.
  void remove(int id);
  [[nodiscard]] std::size_t size() const { return ids_.size(); }

  struct Place {
    int id = 0;
    int score = 0;  // sum of log2 (places / matches), in 1/16
  };
  // The best `most` places of those that are `wanted`, the best first, of equals the newer. Valid until the
  // next call.
  [[nodiscard]] std::span<const Place> query(const FrameFeatures& frame, std::size_t most,
                                             const std::function<bool(int id)>& wanted);

  [[nodiscard]] std::size_t memoryBytes() const;

  // Saved state (state_archive.hpp): the same places.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  using Word = std::uint16_t;
  // The signature above, the slot below.
  using Entry = std::uint64_t;
  static constexpr int kSlotBits = 64 - kSignatureBits;
  static constexpr int kProbeBits =
      4;  // of a word: those nearest to a change, which a query tries with both values
  static constexpr Entry kSlots = (Entry{1} << kSlotBits) - 1;
  static constexpr std::size_t kBlockEntries = 15;
  struct Block {
    std::array<Entry, kBlockEntries> entries;
    std::int32_t next = -1;  // block; of the free ones too
    std::int32_t count = 0;
  };
  struct Code {
    Word word = 0;
    std::array<Word, kProbeBits> least_sure{};  // bits of the word
    Entry signature = 0;                        // slot 0
  };
  struct Id {
    int id = 0;
    std::int32_t slot = 0;
  };
  struct Probe {
    std::int64_t length = 0;  // of the lists that a feature searches
    std::int32_t feature = 0;
  };

  [[nodiscard]] std::size_t featuresOf(const FrameFeatures& frame) const;
  void insertEntry(Word word, Entry entry);
  void eraseEntry(Word word, std::int32_t slot);
  void clear();
  void code(const std::uint8_t* descriptor, Code& code) const;
  [[nodiscard]] static Word probeWord(const Code& code, unsigned flips);
  void countMatches(const Code& code);

  PlaceIndexConfig config_;
  std::vector<std::int16_t> planes_;  // [bit][value], each -1, 0 or 1
  std::vector<Block> blocks_;
  std::int32_t free_block_ = 0;
  std::vector<std::int32_t> heads_, lengths_;  // by word; only the head's block is not full
  std::vector<Word> words_;                    // of each slot's features
  std::vector<std::uint16_t> counts_;          // of each slot
  std::vector<std::int32_t> free_slots_;
  std::vector<Id> ids_;  // rising
  // Scratch memory of a query.
  std::vector<Code> codes_;
  std::vector<Probe> probes_;
  std::vector<std::int32_t> scores_;   // by slot
  std::vector<std::uint8_t> is_met_;   // by slot: matched by the present feature
  std::vector<std::int32_t> matched_;  // slots matched by the present feature
  std::vector<Place> best_;
};

// A relative pose of two frames, of which one may only look like the other place: used once other claims
// confirm it.
struct Claim {
  int a = 0, b = 0;  // frames, the older first
  SE3 T_a_b;
  Matrix6d covariance = Matrix6d::Identity();  // of its right perturbation
  int inliers = 0;
  int wanted = 2;       // claims that must agree, with itself
  double baseline = 0;  // that these must span on either side [m]

  static void exchange(auto& archive, auto& self) {
    archive(self.a, self.b, self.T_a_b, self.covariance, self.inliers, self.wanted, self.baseline);
  }
};

// Claims until others confirm them. Two claims agree when the cycle a - b - b' - a' closes:
//   (T_a_b T_b_b')^-1 (T_a_a' T_a'_b')
// is the identity within the covariances of both and of odometry on either side (99 % of chi-square with 6
// degrees of freedom). Odometry over the short paths a - a' and b - b' is right even where the path from a to
// b is lost. All claims of a set must agree with each other, have different frames on both sides, and span a
// baseline on both: an object that looks like another may fit from several sides, ground does not. Fixed
// memory: when full, the oldest is dropped.
class Agreement {
 public:
  static constexpr int kNeighbours = 6;  // frames within which two claims may agree
  static constexpr std::size_t kWaiting = 64;

  Agreement();

  // Pose of frame y in frame x by odometry, with its covariance.
  using Odometry = std::function<RelativePrior(int x, int y)>;

  // The set that the claim completes, itself the last, which is taken out; empty while too few agree, when
  // the claim is kept. Valid until the next call.
  [[nodiscard]] std::span<const Claim> add(const Claim& claim, const Odometry& odometry);
  // Drops the claims of a frame.
  void remove(int frame) {
    std::erase_if(waiting_, [&](const Claim& w) { return w.a == frame || w.b == frame; });
  }

  [[nodiscard]] std::span<const Claim> waiting() const { return waiting_; }
  [[nodiscard]] std::size_t forgotten() const { return forgotten_; }  // claims dropped when full

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) {
    archive.bounded(self.waiting_, kWaiting);
    archive(self.forgotten_);
  }

 private:
  [[nodiscard]] bool join(const Claim& claim, const Odometry& odometry);

  std::vector<Claim> waiting_;  // oldest first
  std::vector<Claim> agreed_;
  std::uint64_t forgotten_ = 0;
};

// Stricter than with a prior: more inliers, a larger share of the features in the overlap, and more
// significance.
[[nodiscard]] RegistrationConfig recognitionRules();

// Whether the pose keeps the direction of down and the camera's depth: both are measured absolutely, even
// when position and heading are lost. Poses in nav, of which only down and depth count.
[[nodiscard]] bool fitsDownAndDepth(const SE3& T_nav_a, const SE3& T_nav_b, const SE3& T_a_b);

// Claim of a registration without prior. `radius`: of the frames' footprints [m].
[[nodiscard]] Claim recognitionOf(int a, int b, const UncertainPose& found, int inliers, double radius);

}  // namespace fathom::closure
