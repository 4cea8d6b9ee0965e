// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/pem.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

namespace shiftmap::server {
namespace {

struct FreeBio {
  void operator()(BIO* bio) const { BIO_free(bio); }
};
using Bio = std::unique_ptr<BIO, FreeBio>;

Bio BioOf(const std::string& text) {
  return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

}  // namespace

ForgottenErrors::~ForgottenErrors() { ERR_clear_error(); }

std::vector<std::shared_ptr<X509>> CertificatesOfPem(const std::string& pem) {
  std::vector<std::shared_ptr<X509>> certificates;
  const ForgottenErrors forgotten;
  const Bio bio = BioOf(pem);
  while (X509* const x509 = PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr)) {
    certificates.emplace_back(x509, X509_free);
  }
  return certificates;
}

std::vector<std::shared_ptr<X509_CRL>> CrlsOfPem(const std::string& pem) {
  std::vector<std::shared_ptr<X509_CRL>> crls;
  const ForgottenErrors forgotten;
  const Bio bio = BioOf(pem);
  while (X509_CRL* const crl = PEM_read_bio_X509_CRL(bio.get(), nullptr, nullptr, nullptr)) {
    crls.emplace_back(crl, X509_CRL_free);
  }
  return crls;
}

std::shared_ptr<EVP_PKEY> PrivateKeyOfPem(const std::string& pem) {
  const ForgottenErrors forgotten;
  const Bio bio = BioOf(pem);
  // OpenSSL would ask for a password on the terminal.
  const auto no_password = [](char*, int, int, void*) { return 0; };
  return {PEM_read_bio_PrivateKey(bio.get(), nullptr, no_password, nullptr), EVP_PKEY_free};
}

}  // namespace shiftmap::server
