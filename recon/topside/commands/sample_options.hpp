#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "recon/import/images/image_samples.hpp"

namespace fathom::topside {

// --left-format and --right-format, to be read by samplesNamed().
inline void addSampleOptions(CLI::App& command, std::string& left, std::string& right) {
  const auto names = CLI::IsMember(sampleNames());
  command
      .add_option("--left-format", left,
                  "of the samples; auto: as the file says, a grey *_LC16 is a Bayer mosaic")
      ->check(names)
      ->capture_default_str();
  command.add_option("--right-format", right, "as --left-format")->check(names)->capture_default_str();
}

}  // namespace fathom::topside
