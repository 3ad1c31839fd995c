#include "recon/products/exports/sparse_model.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <span>

#include "realtime/base/numbers/union_find.hpp"

namespace fathom::topside {
namespace {

using Member = SparseModel::Member;

// Sets of features, numbered through all views.
class Sets {
 public:
  explicit Sets(const std::vector<StereoView>& views) {
    std::size_t count = 0;
    for (const StereoView& view : views) {
      first_.push_back(static_cast<std::uint32_t>(count));
      count += view.features.size();
    }
    sets_.reset(count);
  }
  void join(const Member& one, const Member& other) { sets_.join(number(one), number(other)); }
  [[nodiscard]] std::uint32_t setOf(const Member& member) { return sets_.root(number(member)); }

 private:
  [[nodiscard]] std::uint32_t number(const Member& m) const { return first_[m.view] + m.feature; }
  std::vector<std::uint32_t> first_;
  UnionFind sets_;
};

class PointMaker {
 public:
  explicit PointMaker(SparseModel& model) : model_(model) {}

  // The features of one set, by view.
  void addSet(std::span<const Member> set) {
    const bool contradicts = std::adjacent_find(set.begin(), set.end(), [](const Member& x, const Member& y) {
                               return x.view == y.view;
                             }) != set.end();
    if (set.size() == 1 || contradicts) return addEach(set);
    const Eigen::Vector3d place = meanOf(set);
    std::vector<Member> agree, off;
    for (const Member& m : set) (errorOf(m, place) <= kMostError ? agree : off).push_back(m);
    addEach(off);
    if (off.empty())
      addPoint(agree, place);
    else if (agree.size() > 1)
      addSet(agree);
    else
      addEach(agree);
  }

 private:
  [[nodiscard]] const closure::Feature& featureOf(const Member& m) const {
    return model_.views[m.view].features[m.feature];
  }
  [[nodiscard]] Eigen::Vector3d meanOf(std::span<const Member> set) const {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Member& m : set) {
      const SE3& T_world_cam = model_.views[m.view].T_world_cam;
      const Eigen::Matrix3d R = T_world_cam.matrix3();
      const Eigen::Matrix3d one = R * featureOf(m).covarianceMatrix().inverse() * R.transpose();
      information += one;
      sum += one * (T_world_cam * featureOf(m).point.cast<double>());
    }
    return information.ldlt().solve(sum);
  }
  [[nodiscard]] double errorOf(const Member& m, const Eigen::Vector3d& place) const {
    const auto [left, right] = pixelErrors(model_.rig, model_.views[m.view].T_world_cam, featureOf(m), place);
    return (left + right) / 2;
  }
  void addEach(std::span<const Member> set) {
    for (const Member& m : set)
      addPoint(std::span(&m, 1), model_.views[m.view].T_world_cam * featureOf(m).point.cast<double>());
  }
  void addPoint(std::span<const Member> set, const Eigen::Vector3d& place) {
    SparsePoint point;
    point.place = place;
    point.first = static_cast<std::uint32_t>(model_.members.size());
    point.views = static_cast<std::uint32_t>(set.size());
    double sum = 0;
    for (const Member& m : set) {
      sum += errorOf(m, place);
      model_.views[m.view].point_of[m.feature] = static_cast<std::uint32_t>(model_.points.size());
    }
    point.error = static_cast<float>(sum / static_cast<double>(set.size()));
    model_.members.insert(model_.members.end(), set.begin(), set.end());
    model_.points.push_back(point);
  }

  SparseModel& model_;
};

}  // namespace

void joinFeatures(const std::vector<ViewMatches>& links, SparseModel& model) {
  Sets sets(model.views);
  for (const ViewMatches& link : links)
    for (const closure::Match& match : link.matches)
      sets.join({link.a, static_cast<std::uint32_t>(match.a)}, {link.b, static_cast<std::uint32_t>(match.b)});
  std::vector<std::pair<std::uint32_t, Member>> all;
  for (std::uint32_t v = 0; v < model.views.size(); ++v) {
    StereoView& view = model.views[v];
    view.point_of.assign(view.features.size(), 0);
    for (std::uint32_t k = 0; k < view.features.size(); ++k) all.push_back({sets.setOf({v, k}), {v, k}});
  }
  std::stable_sort(all.begin(), all.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
  PointMaker maker(model);
  std::vector<Member> set;
  for (std::size_t k = 0; k < all.size(); ++k) {
    set.push_back(all[k].second);
    if (k + 1 < all.size() && all[k + 1].first == all[k].first) continue;
    maker.addSet(set);
    set.clear();
  }
}

}  // namespace fathom::topside
