// SPDX-License-Identifier: BSD-3-Clause
//
// The little of SQLite that the map file needs, as C++ values. Every failure is a SqliteError;
// the map file turns it into the sentence that fits.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

struct sqlite3;
struct sqlite3_stmt;

namespace airslam {

// What SQLite answered, with its (primary) result code.
class SqliteError : public std::runtime_error {
 public:
  SqliteError(int result_code, const std::string& text)
      : std::runtime_error(text), result_code_(result_code) {}
  int result_code() const { return result_code_; }

 private:
  int result_code_;
};

// An open database. Not thread-safe. Its statements know row_checksum(...): FNV-1a, 64 bits, over
// all arguments, each as a letter for its type (i, r, t, b, n) and its little-endian bytes, text
// and BLOBs after their uint64 size; the result as int64. -0.0 counts as 0.0, as which it is
// stored.
class SqliteDatabase {
 public:
  enum class Mode { kCreate, kReadOnly };
  SqliteDatabase(const std::filesystem::path& file, Mode mode);
  ~SqliteDatabase();
  SqliteDatabase(const SqliteDatabase&) = delete;
  SqliteDatabase& operator=(const SqliteDatabase&) = delete;

  // Runs one or more statements and ignores their rows.
  void Execute(const std::string& sql);
  // The single integer or text that a query answers; 0 or "" without a row.
  std::int64_t QueryInteger(const std::string& sql);
  std::string QueryText(const std::string& sql);
  // How many rows the last statement inserted, changed or deleted.
  int Changes() const;

  sqlite3* handle() const { return handle_; }

 private:
  sqlite3* handle_ = nullptr;
};

// A prepared statement. Parameters count from 1, columns from 0, as in SQLite. Bound text and blobs
// must live until the statement has run.
class SqliteStatement {
 public:
  SqliteStatement(SqliteDatabase& database, const std::string& sql);

  void Bind(int parameter, std::int64_t value);
  void Bind(int parameter, double value);
  void Bind(int parameter, std::string_view text);
  void Bind(int parameter, std::span<const std::byte> blob);
  void BindNull(int parameter);

  // Advances to the next row; false when there is none.
  bool Step();
  // Runs a statement that answers no rows, then makes it ready to be bound again.
  void Run();
  void Reset();

  std::int64_t Integer(int column) const;
  double Real(int column) const;
  std::string Text(int column) const;
  // Valid until the next Step, Run or Reset.
  std::span<const std::byte> Blob(int column) const;
  bool IsNull(int column) const;
  int columns() const;
  // SQLITE_INTEGER, SQLITE_FLOAT, ...
  int Type(int column) const;

 private:
  void Check(int result_code) const;

  struct Finalizer {
    void operator()(sqlite3_stmt* statement) const;
  };
  SqliteDatabase& database_;
  std::unique_ptr<sqlite3_stmt, Finalizer> statement_;
};

// A transaction: rolled back unless committed.
class SqliteTransaction {
 public:
  explicit SqliteTransaction(SqliteDatabase& database);
  ~SqliteTransaction();
  SqliteTransaction(const SqliteTransaction&) = delete;
  SqliteTransaction& operator=(const SqliteTransaction&) = delete;
  void Commit();

 private:
  SqliteDatabase& database_;
  bool open_ = true;
};

}  // namespace airslam
