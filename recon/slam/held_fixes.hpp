#pragma once

#include <Eigen/Core>
#include <algorithm>

namespace fathom::slam {

// Where position fixes hold a survey, and how much of an error of its scale or direction they leave. Places
// are north and east in nav [m].
class HeldFixes {
 public:
  void add(const Eigen::Vector2d& place, double sigma, bool by_usbl) {
    (by_usbl ? by_usbl_ : alone_).add(place, sigma);
  }
  // Of all; those of a USBL together say no more of a place than what they share, `shared` [m].
  [[nodiscard]] Eigen::Vector2d middle(double shared) const;
  [[nodiscard]] Eigen::Vector2d middleOfUsbl() const { return by_usbl_.middle(); }
  // Covariance of a place so far from the middle by errors that all links share [m^2]: of the scale of paths,
  // and of their direction [rad], by their variances before. `usbl_turn`: that a USBL's fixes share [rad].
  [[nodiscard]] Eigen::Matrix2d errorOf(const Eigen::Vector2d& from_middle, double scale, double direction,
                                        double usbl_turn) const;

  // For saved state (state_archive.hpp).
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.alone_, self.by_usbl_);
  }

 private:
  struct Sums {
    double weight = 0, squares = 0;                 // of 1 / sigma^2, and of place^2 / sigma^2
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();  // of place / sigma^2

    void add(const Eigen::Vector2d& place, double sigma);
    [[nodiscard]] Eigen::Vector2d middle() const { return weight > 0 ? sum / weight : sum; }
    // Information about a scale or turn about the middle.
    [[nodiscard]] double aboutMiddle() const {
      return weight > 0 ? std::max(0.0, squares - sum.squaredNorm() / weight) : 0;
    }
    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.weight, self.squares, self.sum);
    }
  };
  Sums alone_, by_usbl_;
};

}  // namespace fathom::slam
