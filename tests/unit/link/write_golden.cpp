// Writes proto/golden/*.bin into the folder given. Only for a new version of the protocol: the committed
// files are what other implementations were tested with.
#include <cstdio>
#include <fstream>
#include <string>

#include "golden_messages.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_golden FOLDER\n");
    return 2;
  }
  const auto datagrams = telenano::link::GoldenMessages{}.encoded();
  for (std::size_t i = 0; i < datagrams.size(); ++i) {
    const std::string path = std::string(argv[1]) + "/" + telenano::link::kGoldenNames[i] + ".bin";
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(datagrams[i].data()),
               static_cast<std::streamsize>(datagrams[i].size()));
    if (!file) {
      std::fprintf(stderr, "cannot write %s\n", path.c_str());
      return 1;
    }
  }
  return 0;
}
