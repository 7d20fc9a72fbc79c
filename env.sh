export PYTHONPATH=/tmp/w/s3mine:/tmp/w/s3mine/plugins XDG_CACHE_HOME=/tmp/w/s3mine.cache
