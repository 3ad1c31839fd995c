#include <cstdio>
#include <memory>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"
#include "sim/campaign/campaign.hpp"
#include "sim/commands.hpp"

namespace fathom::sim {

Command addCampaignCommand(CLI::App& app) {
  const auto options = std::make_shared<CampaignOptions>();
  CLI::App* command = app.add_subcommand(
      "campaign", "dive many times in a sea that is disturbed more and more, and see what breaks");
  command->footer("Example: fathom-sim campaign --out missions/campaign --dives 146");
  command
      ->add_option("--out", options->out,
                   "folder for results.jsonl and campaign.html; what it holds is not dived again")
      ->required();
  command->add_option("--dives", options->dives, "in all")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command->add_option("--only", options->only, "this dive alone, again, and its mission stays");
  command->add_option("--seed", options->seed, "another gives other dives")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command->add_option("--jobs", options->jobs, "dives at a time, a core each")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  command->add_option("--programs", options->programs,
                      "folder of fathom-onboard and fathom-topside (this program's own)");
  return {command, [options] {
            if (options->programs.empty())
              options->programs = std::filesystem::read_symlink("/proc/self/exe").parent_path();
            rt::ProgressBar bar;
            options->progress = [&bar](std::size_t done, std::size_t total) {
              bar.show(done, total, "dives");
            };
            const auto dives = runCampaign(*options);
            std::printf("%zu dives: %s\n", dives.size(), (options->out / "campaign.html").c_str());
            return kExitSuccess;
          }};
}

}  // namespace fathom::sim
