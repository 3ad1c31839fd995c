// Report on the incremental solver: pose graphs given pose by pose, each step timed.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "recon/slam/batch_solver.hpp"
#include "recon/slam/g2o_file.hpp"
#include "recon/slam/incremental_solver.hpp"
#ifdef FATHOM_HAVE_CERES
#include "tests/bench/slam/ceres_peer.hpp"
#endif
#include "tests/bench/slam/step_times.hpp"
#include "tests/bench/slam/survey_graph.hpp"

namespace {

using namespace fathom;

void report(const std::string& name, slam::PoseGraph graph, std::int64_t blocks) {
  const auto closures =
      static_cast<int>(std::count_if(graph.edges.begin(), graph.edges.end(), [](const slam::RelativePose& e) {
        return e.from != slam::kWorld && std::abs(e.to - e.from) > 1;
      }));
  slam::IncrementalConfig config;
  config.max_poses = static_cast<int>(graph.poses.size());
  config.max_measurements = static_cast<int>(graph.edges.size());
  config.max_factor_blocks =
      blocks > 0 ? blocks : slam::IncrementalConfig::blocksFor(config.max_poses, closures);
  slam::IncrementalSolver solver(config);
  bench::print(name, bench::timeSteps(graph, solver), solver);
}

#ifdef FATHOM_HAVE_CERES
// The whole graph at once, ours and Ceres in turns on one thread, timed by its own clock; each
// the best of some runs. From the same poses: those of
// the file, where ours tries a chordal start as well, and the chordal ones.
void compareWithCeres(const std::string& name, const slam::PoseGraph& graph) {
  constexpr int kRuns = 3;
  slam::PoseGraph chordal = graph;
  chordal.poses = slam::chordalPoses(graph);
  for (const slam::PoseGraph* start : {&graph, static_cast<const slam::PoseGraph*>(&chordal)}) {
    double ours = 0, ours_chi2 = 0;
    bench::CeresOutcome best;
    for (int run = 0; run < kRuns; ++run) {
      slam::PoseGraph mine = *start, theirs = *start;
      const double begin = bench::threadMilliseconds();
      ours_chi2 = slam::optimize(mine, {}).chi2;
      const double seconds = 1e-3 * (bench::threadMilliseconds() - begin);
      ours = run == 0 ? seconds : std::min(ours, seconds);
      const bench::CeresOutcome peer = bench::solveByCeres(theirs);
      if (run == 0 || peer.seconds < best.seconds) best = peer;
    }
    std::printf(
        "%s from %s poses: ours %.3f s, chi2 %.6f; Ceres %.3f s, chi2 %.6f (%d iterations, %s), by its "
        "default "
        "trust region %.3f s: ours is %.2f and %.2f times faster\n",
        name.c_str(), start == &graph ? "the file's" : "chordal", ours, ours_chi2, best.seconds, best.chi2,
        best.iterations, best.options.c_str(), best.usual_seconds, best.seconds / ours,
        best.usual_seconds / ours);
  }
}
#endif

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Report on the incremental solver");
  std::vector<std::string> files;
  bench::SurveyPlan plan;
  bool survey = false, anywhere = false;
  std::int64_t blocks = 0;
  app.add_option("graphs", files, "g2o files; without any, the three graphs that the tests use");
  app.add_flag("--survey", survey, "a made-up survey instead");
  app.add_option("--keyframes", plan.keyframes, "of the survey");
  app.add_option("--closures", plan.closures, "of the survey");
  app.add_flag("--anywhere", anywhere, "closures join any two keyframes");
  app.add_flag("--sensors", plan.attitude_and_depth, "attitude and depth of every keyframe");
  app.add_option("--blocks", blocks, "room of a factor; without it by IncrementalConfig::blocksFor");
#ifdef FATHOM_HAVE_CERES
  bool batch = false;
  app.add_flag("--ceres", batch, "the whole graph at once instead, ours against Ceres");
#endif
  CLI11_PARSE(app, argc, argv);
  if (survey) {
    if (anywhere) plan.where = bench::Closures::kAnywhere;
    report("survey", bench::makeSurvey(plan).graph, blocks);
    return 0;
  }
  if (files.empty())
    for (const char* name : {"tinyGrid3D", "parking-garage", "sphere2500"})
      files.push_back(std::string(FATHOM_DATA_DIR "/posegraph/") + name + ".g2o");
  for (const std::string& file : files) {
    const std::string name = file.substr(file.rfind('/') + 1);
#ifdef FATHOM_HAVE_CERES
    if (batch) {
      compareWithCeres(name, slam::readG2o(file));
      continue;
    }
#endif
    report(name, slam::readG2o(file), blocks);
  }
}
