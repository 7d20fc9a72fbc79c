"""Files from elsewhere, damaged, tampered with or made to do harm, and all that reads them."""
