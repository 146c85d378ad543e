// The page's own policy forbids scripts within it, so Swagger UI is started from here.
window.SwaggerUIBundle({
  url: "/openapi.json",
  dom_id: "#swagger-ui",
  deepLinking: true,
  displayRequestDuration: true,
  // Its validator would send the description to another host.
  validatorUrl: null,
  presets: [window.SwaggerUIBundle.presets.apis],
});
