// The main of every test program: its temporary files are in a folder of their own, which stays when a test
// failed.
#include <gmock/gmock.h>
#include <stdlib.h>

#include <cstdio>
#include <filesystem>

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  std::string folder = (std::filesystem::temp_directory_path() / "fathom-test-XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) {
    std::perror(folder.c_str());
    return 1;
  }
  ::setenv("TMPDIR", folder.c_str(), 1);
  ::setenv("TEST_TMPDIR", folder.c_str(), 1);
  const int status = RUN_ALL_TESTS();
  std::error_code ignored;
  if (status == 0)
    std::filesystem::remove_all(folder, ignored);
  else
    std::printf("What the tests wrote is in %s\n", folder.c_str());
  return status;
}
