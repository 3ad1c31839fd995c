// A navigation graph goes on in the memory of a part of its dive.
#include <gtest/gtest.h>

#include <cmath>

#include "recon/slam/navigation_batch.hpp"
#include "recon/slam/navigation_graph.hpp"
#include "tests/slam/made_survey.hpp"

namespace fathom::slam {
namespace {

using testing::MadeSurvey;
using testing::MadeSurveyOptions;

NavigationConfig configOf(int keyframes) {
  NavigationConfig config;
  config.max_keyframes = keyframes;
  config.max_links = 6 * keyframes;
  config.max_fixes = keyframes;
  return config;
}

MadeSurveyOptions longSurvey() {
  MadeSurveyOptions options;
  options.lines = 40;
  options.line_length = 35;
  options.line_spacing = 0.6;
  options.closure_share = 0.1;
  return options;
}

// Poses of all keyframes of a dive: those that have retired hang on others.
class Track {
 public:
  void note(const NavigationGraph& graph, const SE3& T_odom_cam) {
    hang_.push_back({graph.keyframes() - 1, T_odom_cam});
    for (const NavigationGraph::Retired& gone : graph.retired())
      for (Hanging& h : hang_)
        if (h.on == gone.keyframe) h = {gone.onto, gone.T_onto * h.T_odom};
  }
  [[nodiscard]] SE3 pose(const NavigationGraph& graph, int k) const {
    const Hanging& h = hang_[static_cast<std::size_t>(k)];
    return graph.pose(h.on) * graph.odometry(h.on).inverse() * h.T_odom;
  }

 private:
  struct Hanging {
    int on;
    SE3 T_odom;
  };
  std::vector<Hanging> hang_;
};

TEST(LongDive, X) {
  const MadeSurveyOptions options = longSurvey();
  const MadeSurvey survey = testing::makeSurvey(options);
  const int all = static_cast<int>(survey.inputs.size());
  std::printf("%d keyframes %zu closures %zu fixes\n", all, survey.closures.size(), survey.fixes.size());
  std::vector<std::vector<SE3>> ends;
  std::vector<std::vector<double>> online;
  for (const int pool : {300, 600, 4000}) {
    NavigationGraph graph(configOf(pool));
    Track track;
    graph.setAnchor(survey.anchor, options.anchor_sigma);
    std::vector<double> now;
    for (int k = 0; k < all; ++k) {
      testing::driveOn(graph, survey, options, k + 1);
      ASSERT_EQ(graph.keyframes(), k + 1);
      track.note(graph, survey.inputs[static_cast<std::size_t>(k)].T_odom_cam);
      now.push_back((graph.pose(k).translation() - survey.truth[static_cast<std::size_t>(k)].translation())
                        .head<2>()
                        .norm());
    }
    for (int i = 0; i < 30; ++i) (void)graph.step();
    online.push_back(now);
    std::vector<SE3> end;
    for (int k = 0; k < all; ++k) end.push_back(track.pose(graph, k));
    ends.push_back(end);
    const auto& c = graph.counters();
    std::printf("pool %d: retired %llu, references %llu (%llu retired), closures %llu fixes %llu contradicting %llu off %llu, fixes off %llu gated %llu, refused %llu %llu, chi2 %g dropped %lld\n", pool,
                (unsigned long long)c.keyframes_retired, (unsigned long long)c.references,
                (unsigned long long)c.references_retired, (unsigned long long)c.closures,
                (unsigned long long)c.fixes, (unsigned long long)c.links_contradicting,
                (unsigned long long)c.links_off, (unsigned long long)c.fixes_off, (unsigned long long)c.fixes_gated, (unsigned long long)c.links_refused,(unsigned long long)c.keyframes_refused,
                graph.solver().chi2(), (long long)graph.solver().fillDropped());
  }
  std::vector<NavigationLink> links;
  std::vector<NavigationFix> fixes;
  for (const auto* list : {&survey.visual, &survey.closures})
    for (const MadeSurvey::Link& l : *list) {
      NavigationLink link;
      link.a = static_cast<std::size_t>(l.a);
      link.b = static_cast<std::size_t>(l.b);
      link.T_a_b = l.T_a_b;
      link.covariance = survey.link_covariance;
      links.push_back(link);
    }
  for (const MadeSurvey::Fix& f : survey.fixes) {
    NavigationFix fix;
    fix.frame = f.keyframe;
    fix.antenna_in_odom = f.antenna_in_odom;
    fix.north_east = f.north_east;
    fix.sigma = options.usbl_sigma;
    fixes.push_back(fix);
  }
  const NavigationSolution batch =
      solveNavigation({}, survey.inputs, survey.anchor, options.anchor_sigma, links, fixes);
  ends.push_back(batch.poses);
  for (std::size_t r = 0; r < ends.size(); ++r) {
    const auto e = testing::errorsOf(ends[r], survey.truth);
    std::printf("%zu: absolute %.4f aligned %.4f\n", r, e.absolute, e.aligned);
  }
  for (int from = 0; from + 60 <= all; from += 300) {
    std::printf("%5d end", from);
    for (const auto& end : ends) {
      double sum = 0;
      for (int k = from; k < from + 60; ++k)
        sum += (end[static_cast<std::size_t>(k)].translation() - survey.truth[static_cast<std::size_t>(k)].translation()).head<2>().squaredNorm();
      std::printf(" %.4f", std::sqrt(sum / 60));
    }
    std::printf("  online");
    for (const auto& o : online) {
      double sum = 0;
      for (int k = from; k < from + 60; ++k) sum += o[static_cast<std::size_t>(k)] * o[static_cast<std::size_t>(k)];
      std::printf(" %.4f", std::sqrt(sum / 60));
    }
    std::printf("\n");
  }
}

}  // namespace
}  // namespace fathom::slam
