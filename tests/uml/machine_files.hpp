#pragma once

// Messages between the program outside (uml_run) and the first process inside (uml_init): files of a job
// folder on the host, which the machine sees through hostfs. Lists are sequences of NUL-terminated strings.
namespace fathom::uml {

inline constexpr const char* kJobVariable = "FATHOM_UML_JOB";    // kernel parameter: the job folder
inline constexpr const char* kDiskVariable = "FATHOM_UML_DISK";  // of the command: where its disk is mounted

inline constexpr const char* kArgumentsFile = "arguments";      // list: the command
inline constexpr const char* kEnvironmentFile = "environment";  // list: NAME=VALUE
inline constexpr const char* kFolderFile = "folder";            // list of one: where the command starts
inline constexpr const char* kCanFile = "can";                  // present: CAN interfaces are wanted
inline constexpr const char* kLoopFile = "loop";  // list of one: the image, when its drive is a loop device
inline constexpr const char* kOutputFile = "stdout";
inline constexpr const char* kErrorsFile = "stderr";
inline constexpr const char* kStartedFile = "started";  // appears when the command starts
inline constexpr const char* kStatusFile = "status";    // text: exit status of the command, once it has ended
inline constexpr const char* kFailureFile = "failure";  // text: why the machine could not be set up
inline constexpr const char* kDiskFolder = "disk";      // mount point, when there is a disk

inline constexpr int kSkipped = 77;  // uml_run's status where this machine can run none: ctest skips
inline constexpr const char* kKernel = "/usr/bin/linux.uml";  // of the Debian package user-mode-linux
inline constexpr const char* kModulesFolder = "/usr/lib/uml/modules";

}  // namespace fathom::uml
