# palpate from this checkout: docker build -t palpate . && docker run --rm -v "$PWD:/data" palpate run point.toml
FROM python:3.12-slim AS build
WORKDIR /src
COPY . .
RUN pip install --no-cache-dir build && python -m build --wheel --outdir /wheels .

FROM python:3.12-slim
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir "$(ls /wheels/*.whl)[fast,notebook]" && rm -r /wheels \
    && useradd --create-home palpate
USER palpate
WORKDIR /data
ENTRYPOINT ["palpate"]
CMD ["--help"]
