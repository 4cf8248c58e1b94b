// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace airslam {

inline std::string ReadText(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw std::runtime_error("cannot read " + file.string());
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

inline std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// What a run of the program left behind.
struct ProgramResult {
  int exit_code = -1;  // 128 + signal when one ended it
  std::string out, err;

  // The lines of the standard error stream but for warnings and progress.
  std::vector<std::string> Complaints() const {
    std::vector<std::string> lines = Lines(err);
    std::erase_if(lines, [](const std::string& line) {
      return line.starts_with("airslam: warning: ") || line.starts_with("map ");
    });
    return lines;
  }
};

// The built program `airslam`, run as a child with an empty environment. The sanitizers' settings
// alone are passed on: they belong to the test.
class Program {
 public:
  struct Limits {
    rlim_t file_bytes = RLIM_INFINITY;  // beyond this, writing to a file fails
    std::string standard_output = "";   // a file for it, in place of one that is read back
    std::string temporary_files = "";   // TMPDIR
  };

  // Starts it in the folder `where`, which also takes its output.
  Program(const std::filesystem::path& where, const std::vector<std::string>& arguments,
          const Limits& limits)
      : out_(where / ".stdout"), err_(where / ".stderr") {
    std::vector<std::string> words = {AIRSLAM_BINARY_DIR "/bin/airslam"};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<std::string> environment;
    for (const char* name : {"ASAN_OPTIONS", "UBSAN_OPTIONS", "LSAN_OPTIONS", "TSAN_OPTIONS"}) {
      if (const char* value = std::getenv(name)) {
        environment.push_back(std::string(name) + '=' + value);
      }
    }
    if (!limits.temporary_files.empty()) {
      environment.push_back("TMPDIR=" + limits.temporary_files);
    }
    const std::vector<char*> argv = Pointers(words), envp = Pointers(environment);
    child_ = fork();
    if (child_ < 0) throw std::runtime_error("cannot fork");
    if (child_ == 0) Execute(where, argv, envp, limits);
  }
  ~Program() {
    if (child_ > 0) {
      Kill();
      waitpid(child_, nullptr, 0);
    }
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  void Kill() { Send(SIGKILL); }
  void Send(int signal_number) { kill(child_, signal_number); }

  bool IsRunning() {
    siginfo_t info = {};
    waitid(P_PID, static_cast<id_t>(child_), &info, WEXITED | WNOHANG | WNOWAIT);
    return info.si_pid == 0;
  }

  ProgramResult Wait() {
    int status = 0;
    if (waitpid(child_, &status, 0) != child_) throw std::runtime_error("cannot wait");
    child_ = -1;
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return {code, std::filesystem::exists(out_) ? ReadText(out_) : "", ReadText(err_)};
  }

 private:
  static std::vector<char*> Pointers(std::vector<std::string>& words) {
    std::vector<char*> pointers;
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    return pointers;
  }

  [[noreturn]] void Execute(const std::filesystem::path& where, const std::vector<char*>& argv,
                            const std::vector<char*>& envp, const Limits& limits) const {
    constexpr int kFlags = O_WRONLY | O_CREAT | O_TRUNC;
    const bool ready =
        chdir(where.c_str()) == 0 &&
        dup2(open(limits.standard_output.empty() ? out_.c_str() : limits.standard_output.c_str(),
                  kFlags, 0600),
             STDOUT_FILENO) >= 0 &&
        dup2(open(err_.c_str(), kFlags, 0600), STDERR_FILENO) >= 0;
    if (limits.file_bytes != RLIM_INFINITY) {
      signal(SIGXFSZ, SIG_IGN);  // writing then fails, as on a full disk
      const rlimit limit = {limits.file_bytes, limits.file_bytes};
      setrlimit(RLIMIT_FSIZE, &limit);
    }
    if (ready) execve(argv[0], argv.data(), envp.data());
    _exit(126);
  }

  std::filesystem::path out_, err_;
  pid_t child_ = -1;
};

inline ProgramResult RunProgram(const std::filesystem::path& where,
                                const std::vector<std::string>& arguments,
                                const Program::Limits& limits = {}) {
  return Program(where, arguments, limits).Wait();
}

}  // namespace airslam
