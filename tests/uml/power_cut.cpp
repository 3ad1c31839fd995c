#include "tests/uml/power_cut.hpp"

#include <algorithm>

#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/text_files.hpp"
#include "tests/uml/machine.hpp"

namespace fathom::uml {
namespace {

constexpr std::int64_t kMostLostMs = 1000;

// "dive_recorder: found LOG_BYTES CUT WITHOUT_EVENT HALVES" of the second run.
void readFound(const std::string& text, PowerCut& cut) {
  const std::size_t at = text.find("found ");
  if (at == std::string::npos) return;
  std::istringstream words(text.substr(at + 6));
  std::uint64_t log_bytes = 0;
  words >> log_bytes >> cut.log_bytes_cut >> cut.images_without_event >> cut.halves;
}

}  // namespace

PowerCut cutPower(const PowerCutOptions& options, const std::filesystem::path& folder) {
  const std::string disk = (folder / "disk.img").string(), status_file = (folder / "status").string();
  const std::string record = std::string(FATHOM_BIN_DIR) + "/dive_recorder $FATHOM_UML_DISK/dive --width " +
                             std::to_string(options.width) + " --height " + std::to_string(options.height);
  PowerCut cut{.wrong = {}, .cut_after_s = options.cut_after_s};

  const std::string drive =
      options.drive_seed ? " --volatile-cache " + std::to_string(*options.drive_seed) : "";
  const MachineRun first = runMachine("--disk " + disk + " --format 128" + drive + " --cut-after " +
                                      std::to_string(options.cut_after_s) + " -- bash -c '" + record +
                                      " --durable-status > " + status_file + "'");
  if (first.status == kSkipped) {
    cut.skipped = true;
    return cut;
  }
  if (first.status != 0) {
    cut.wrong.push_back("the recording machine: " + first.output);
    return cut;
  }
  const test::RecorderStatus status(test::readText(status_file));
  cut.began = !status.lines.empty();
  if (!cut.began) return cut;
  const MachineRun second = runMachine(
      "--disk " + disk + " -- bash -c 'cp -a $FATHOM_UML_DISK/dive " + folder.string() + "/first && " +
      record + " --seconds 0.5 > /dev/null && cp -a $FATHOM_UML_DISK/dive " + folder.string() + "/second'");
  if (second.status != 0) cut.wrong.push_back("the machine that reads back: " + second.output);
  if (second.status != 0) return cut;
  readFound(second.output, cut);

  const test::SyntheticDive dive({options.width, options.height, 50});
  try {
    const test::SyntheticDive::Found found = dive.check(folder / "first");
    const test::SyntheticDive::Found after = dive.check(folder / "second");
    cut.wrong.insert(cut.wrong.end(), found.wrong.begin(), found.wrong.end());
    cut.wrong.insert(cut.wrong.end(), after.wrong.begin(), after.wrong.end());
    cut.offered = status.offered();
    cut.durable = status.safe();
    cut.found = found.next;
    cut.lost_ms = status.lostMs(found.next);
    cut.images = found.images;
    cut.after_restart = after.inputs - std::min(after.inputs, found.inputs);
    if (found.skipped != 0) cut.wrong.push_back("inputs are missing in the middle");
    if (found.next < cut.durable) cut.wrong.push_back("an input that was reported durable is lost");
    if (cut.lost_ms > kMostLostMs) cut.wrong.push_back("more than a second is lost");
    if (cut.after_restart == 0) cut.wrong.push_back("recording did not continue");
  } catch (const InputError& e) {
    cut.wrong.push_back(e.what());
  }
  return cut;
}

}  // namespace fathom::uml
