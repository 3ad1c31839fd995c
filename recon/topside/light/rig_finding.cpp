#include "recon/topside/light/rig_finding.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "realtime/kernel/text.hpp"
#include "recon/calibration/epipolar_check.hpp"
#include "recon/topside/calibration/free_matches.hpp"
#include "recon/topside/light/pair_images.hpp"

namespace fathom::topside {

namespace {

calibration::EpipolarCheck checkPairs(const MissionInput& input, const Survey& survey,
                                      const LightingModels& models, std::size_t wanted) {
  std::vector<std::size_t> known;
  for (std::size_t k = 0; k < survey.list.pairs.size(); ++k)
    if (survey.planes[k]) known.push_back(k);
  const std::size_t count = std::min(known.size(), wanted);
  std::vector<std::vector<RigMatch>> found(count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    const std::size_t pair = known[k * known.size() / count];
    PairImages images(input, models);
    if (!images.read(survey.list.pairs[pair])) return;
    images.correct(*survey.planes[pair]);
    found[k] = matchFreely(input.rig, images.left(), images.right(), *survey.planes[pair]);
  });
  std::vector<RigMatch> matches;
  for (const auto& some : found) matches.insert(matches.end(), some.begin(), some.end());
  return calibration::checkEpipolar(input.rig, matches);
}

}  // namespace

RigFinding findRig(const MissionInput& input, const Survey& survey, const LightingModels& models) {
  calibration::EpipolarCheck check = checkPairs(input, survey, models, kRigPairs);
  if (calibration::explainsMove(check)) check = checkPairs(input, survey, models, kMovedRigPairs);
  RigFinding out;
  out.matches = check.errors.size();
  out.before = check.worst();
  out.after = check.sigma_after;
  out.moved = calibration::explainsMove(check);
  out.rotation = check.rotation;
  out.focal = check.focal;
  return out;
}

StereoRig rigAsFound(const StereoRig& rig, const RigFinding& found) {
  if (!found.moved) return rig;
  return calibration::changed(rig, found.rotation, found.focal);
}

std::optional<std::string> warningOf(const RigFinding& found) {
  if (!found.moved) return std::nullopt;
  return "The rig does not stand as it was calibrated: matches lie up to " + decimals(found.before, 1) +
         " px off their epipolar lines. This run takes " +
         calibration::describeChange(found.rotation, found.focal) + ", which leaves " +
         decimals(found.after, 2) + " px a match. Calibrate again.";
}

}  // namespace fathom::topside
