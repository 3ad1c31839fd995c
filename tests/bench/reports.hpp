#pragma once

#include "realtime/base/command_line.hpp"

namespace fathom::bench {

// The subcommands of fathom-report.
void camerasReport(CommandLine& program);
void closureReport(CommandLine& program);
void colmapReport(CommandLine& program);
void enduranceReport(CommandLine& program);
void fusionReport(CommandLine& program);
void hostileReport(CommandLine& program);
void linkReport(CommandLine& program);
void matchErrorReport(CommandLine& program);
void realtimeReport(CommandLine& program);
void recorderReport(CommandLine& program);
void restartReport(CommandLine& program);
void slamReport(CommandLine& program);
void stereoReport(CommandLine& program);

}  // namespace fathom::bench
